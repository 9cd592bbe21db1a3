"""Progress: who is told how far a study is; needs no PyTorch."""


class Progress:
    """Told what goes on; this one keeps it to itself."""

    def plan(self, n_clouds: int, n_trials: int) -> None:
        """Hear how much there will be to do: clouds to be made and classifiers to be trained and tested."""

    def clouds(self, n: int) -> None:
        """Hear that this many more clouds are done."""

    def trial(self, key: str, share: float) -> None:
        """Hear which classifier is being trained, and which share of its training is done; 1: tested too."""
