"""`sensors`: the table, one sensor's numbers with their sources, the picture of its rays."""

import json
from pathlib import Path

from PIL import Image

from tests.cli.conftest import Run
from zbuf_occlude.sensors import SENSORS


def test_the_table(run: Run) -> None:
    out = run("sensors").out
    assert [line.split()[0] for line in out.splitlines()] == list(SENSORS)
    documents = json.loads(run("sensors", "--json").out)
    assert [document["name"] for document in documents] == list(SENSORS)
    assert all(number["source"] for document in documents for number in document["numbers"].values())


def test_one_sensor_and_its_picture(run: Run, tmp_path: Path) -> None:
    picture = tmp_path / "rays.png"
    outcome = run("sensors", "vlp-32c", "--picture", picture)
    assert outcome.code == 0, outcome.err
    assert "57,600 rays, elevations -25.00 to 15.00 degrees" in outcome.out
    assert "columns = 1800    [0.2 degrees at 10 turns a second, maker's manual]" in outcome.out
    with Image.open(picture) as image:
        assert len(image.getcolors(10**7)) > 100


def test_wrong_words(run: Run, tmp_path: Path) -> None:
    for arguments, words in (
        (("vlp-17",), "error: sensor must be one of vlp-16,"),
        (("--picture", tmp_path / "a.png"), "--picture shows one sensor's rays; name the sensor."),
        (("vlp-16", "--picture", tmp_path / "a.gif"), "must end in .png; got 'a.gif'"),
        ((tmp_path / "none.yaml",), "a file must be readable"),
    ):
        outcome = run("sensors", *arguments)
        assert outcome.code == 2
        assert words in outcome.err
