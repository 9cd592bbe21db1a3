"""How large a study is: what changes with an option, and what stays."""

from dataclasses import replace

import pytest

from zbuf_occlude.errors import OptionError
from zbuf_occlude.paper.design import FULL, QUICK, changed
from zbuf_occlude.paper.trials import as_many_clouds, as_many_epochs


def test_what_a_size_has_already_changes_nothing_but_its_name() -> None:
    same = changed(QUICK, models=QUICK.models, seeds=3, objects=24, points=[256], epochs=30)
    expected = replace(
        QUICK,
        name="quick, voxnet pointnet threedmfv5-small, 3 seeds, 24 objects of a class, 256 points, 30 epochs",
        summary=same.summary,
        shares=(24, 6, 15),
        elevation_each=24,
        elevation_seeds=(0, 1, 2),
        augmentation_models=QUICK.models,
        elevation_epochs=30,
    )
    assert same == expected


def test_objects_keep_the_papers_shares_and_how_often_a_cloud_is_shown() -> None:
    assert changed(FULL, objects=40).shares == FULL.shares == (40, 10, 25)
    half = changed(FULL, objects=20)
    assert half.shares == (20, 5, 12)
    assert half.passes == FULL.passes // 2
    assert changed(QUICK, objects=5).shares == (5, 1, 3)


def test_points_keep_the_density() -> None:
    more = changed(QUICK, points=[512, 128])
    assert (more.n_points, more.sampled) == ((512, 128), 3000)
    assert (more.elevation_points, more.elevation_sampled) == (128, 750)


def test_methods_are_compared_by_those_that_are_left() -> None:
    assert changed(QUICK, models=["threedmfv5"]).method_models == ("threedmfv5",)
    assert changed(QUICK, models=["pointnet", "voxnet"]).method_models == ("voxnet",)


def test_budgets() -> None:
    """Of the quick study: 960, 192 and 1,152 clouds to train on."""
    assert [as_many_clouds(QUICK.passes, n) for n in (960, 192, 1152)] == [6, 30, 5]
    assert [as_many_epochs(QUICK.epochs, n) for n in (960, 192, 1152)] == [30, 30, 30]
    assert as_many_clouds(100, 10_000) == 1


@pytest.mark.parametrize(
    ("change", "argument", "message"),
    [
        ("objects", 4, r"objects must lie in 5\.\.40.*got 4"),
        ("objects", 41, "got 41"),
        ("points", [], "points must be numbers of at least 1; got none"),
        ("points", [256, 0], "got 256, 0"),
        ("models", ["alexnet"], "model must be one of voxnet.*got 'alexnet'"),
        ("models", [], "models must name at least one"),
    ],
)
def test_what_no_study_can_have(change: str, argument: object, message: str) -> None:
    with pytest.raises(OptionError, match=message):
        changed(QUICK, **{change: argument})
