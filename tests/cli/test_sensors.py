"""`sensors`: the table, one sensor's numbers with their sources, the picture of its rays."""

import json
from pathlib import Path

import numpy as np
from PIL import Image

from tests.cli.conftest import Run, write_off
from zbuf_occlude.sensors import SENSORS


def test_the_table(run: Run) -> None:
    out = run("sensors").out
    assert [line.split()[0] for line in out.splitlines()] == list(SENSORS)
    documents = json.loads(run("sensors --json").out)
    assert [document["name"] for document in documents] == list(SENSORS)
    assert all(number["source"] for document in documents for number in document["numbers"].values())


def test_one_sensor_and_its_picture(run: Run, tmp_path: Path) -> None:
    picture = tmp_path / "rays.png"
    outcome = run(f"sensors vlp-32c --picture {picture}")
    assert "57,600 rays, elevations -25.00 to 15.00 degrees" in outcome.out
    assert "columns = 1800    [0.2 degrees at 10 turns a second, maker's manual]" in outcome.out
    with Image.open(picture) as image:
        assert len(image.getcolors(10**7)) > 100


def test_what_files_hold_makes_no_second_line(run: Run, tmp_path: Path) -> None:
    write_off(tmp_path / "a.off", np.eye(3), np.array([[0, 1, 2]]))
    (tmp_path / "s.yaml").write_text('kind: spinning\nlasers: [1]\ncolumns: 9\nname: "a\\nerror: b"\n')
    (tmp_path / "s.json").write_text('{"objects": [{"mesh": "a.off\\nerror: b", "position": [0, 0, 0]}]}')
    (tmp_path / "c.json").write_text(f'[{{"R": [[{"9" * 401}, 0, 0]], "t": [0, 0, 0]}}]')
    for line in (
        "sensors s.yaml",
        "scan a.off --sensor vlp-16 --scene s.json --range 5 --size 1 --out o.ply",
        "visible a.off --method oracle --cameras c.json --out o.ply",
    ):
        outcome = run(line, code=2)
        assert outcome.out == ""
        assert len([words for words in outcome.err.splitlines() if words.startswith("error: ")]) == 1, outcome.err
