"""Wrong arguments: one line with the error, the possible values and the nearest one; pages of help."""

import re
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Run, write_off
from zbuf_occlude.cli import COMMANDS

CAMERA = '[{"R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "t": [0, 0, 5]}]'
IN_WORDS = ": No such file or directory"
SHARES = ("3", "2/2", "-1/2", "a/b", "0/0", "5/2")
REFUSED = [
    # words that nearly are one of a table
    ("genrate", "No such command 'genrate'. Did you mean 'generate'?"),
    ("lists", "No such command 'lists'."),  # a module's name
    ("paper tabel2", "No such command 'tabel2'. Did you mean 'table2'?"),
    ("generate --overwrit", "No such option '--overwrit'"),
    ("generate --method exakt", "got 'exakt'. Did you mean 'exact'?"),
    ("generate --method 'depth buffer'", "Did you mean 'depth_buffer'?"),
    ("generate --format hdf", "got 'hdf'. Did you mean 'hdf5'?"),
    ("generate --preset modelnet40c-lidar", "Did you mean 'modelnet40-c-lidar'?"),
    ("generate --sensor hdl64e", "got 'hdl64e'. Did you mean 'hdl-64e'?"),
    ("generate --sensor vlp-16 --set-sensor colums=9", "got 'colums'. Did you mean 'columns'?"),
    ("generate --sensor vlp-16 --scene streat", "got 'streat'. Did you mean 'street'?"),
    ("sensors VLP16", "got 'VLP16'. Did you mean 'vlp-16'?"),
    ("generate --method exact --set contakt=1", "got 'contakt'. Did you mean 'contact'?"),
    ("generate --method exact --views rng:8@30", "got 'rng:8@30'. There is no 'rng'. Did you mean 'ring'?"),
    # generate
    ("generate --set resolution 1024", "got 'resolution'. Write --set resolution=VALUE."),
    ("generate --sensor vlp-16 --set-sensor columns 9", "--set-sensor must be given KEY=VALUE; got 'columns'."),
    (
        "generate --method exact --views ring:8",
        "After ring: must come N@EL[,az=AZ0..AZ1]",
    ),
    ("generate --method exact --views paper100:3", "paper100 takes nothing after it."),
    ("generate a.off --views fibonacci:999999999999", "n_views must be at most 1,000,000; got 999999999999"),
    ("generate a.off --views grid:1000000x1000000", "the number of views must be at most 1,000,000"),
    (f"generate a.off --points {10**26}", "points must be at most 2,147,483,647"),
    (f"generate a.off --variations {10**26}", "variations must be at most 2,147,483,647"),
    ("generate a.off --sample-size 3000000000", "sample size must be at most 100,000,000"),
    ("generate a.off --sample-size some", "it must be a number of points, at least 1, or all; got 'some'"),
    ("generate a.off --density inf", "density must be at most 2,147,483,647; got inf"),
    ("generate a.off --density=-1", "density must be positive; got -1"),
    ("generate a.off --points 7 --density 2", "exclude each other"),
    ("generate a.off --mesh-seconds nan", "'--mesh-seconds': nan is not a finite number"),
    *((f"generate a.off --shard={share}", f"0 <= I < N; got {share!r}") for share in SHARES),
    ("generate a.off --dry-run --shard ''", "0 <= I < N; got ''"),
    ("generate a.off --dry-run --shard 2/2", "0 <= I < N; got '2/2'"),
    ("generate a.off --sensor vlp-16 --transparent ' '", "--transparent must be NAME or NAME=SHARE, SHARE in 0..1"),
    ("generate a.off --sensor vlp-16 --transparent '=0.5'", "--transparent must be NAME or NAME=SHARE"),
    ("generate a.off --classes ''", "it must be one or more words separated by commas; got ''"),
    ("generate a.off --splits ' , '", "it must be one or more words separated by commas"),
    ("generate a.off --distance 4..2", "distances must run upwards; got 4..2"),
    ("generate a.off --distance=-1", "it must be D or D0..D1, positive and finite; got '-1'"),
    ("generate a.off --distance a..b", "it must be D or D0..D1"),
    ("generate a.off --views gone.csv", "gone.csv" + IN_WORDS),
    ("generate a.off --labels gone.csv", "gone.csv" + IN_WORDS),
    ("generate a.off --sensor gone.yaml", "gone.yaml" + IN_WORDS),
    # options of methods
    ("generate a.off --method oracle --set contact=5", "contact must lie in [0, 1)"),
    ("generate a.off --method oracle --set contact=1e400", "contact must lie in [0, 1), a fraction of the mesh's"),
    ("generate a.off --method oracle --set contact=wide", "must be a number, like the default 1e-05; got 'wide'"),
    pytest.param(
        "generate a.off --method hidden_point_removal --set radius=[1]",
        "radius must be a number, like the default None; got '[1]'",
        marks=pytest.mark.needs("open3d"),
    ),
    *(
        pytest.param(f"generate a.off --method depth_buffer --set {setting}", said, marks=pytest.mark.gl)
        for setting, said in (
            ("resolution=64.5", "resolution must be an int in [16, 8192], pixels along a side; got 64.5"),
            ("resolution=-1", "resolution must be an int in [16, 8192], pixels along a side; got -1"),
            ("resolution=True", "resolution must be a number, like the default 512; got True"),
            ("refine=3", "refine must be a word, like the default witness; got 3"),
        )
    ),
    # places
    *(
        (line, "it must be the name of a file or folder; it is empty. For the current folder, give a dot.")
        for line in (
            "visible '' --out a.ply",
            "depth '' --out a.png",
            "scan '' --out a.ply",
            "generate '' --out o",
            "compare '' --out o",
            "verify . ''",
        )
    ),
    ("generate a.off --out ''", "it must be the name of a folder; it is empty. For the current folder, give a dot."),
    *(
        (f"{line} --out a.off", "'--out': it must be a folder; 'a.off' is a file. Choose another.")
        for line in ("generate a.off", "generate a.off --dry-run", "convert . --format npz", "show .", "compare a.off")
    ),
    *((f"generate {dry} --out a.off/a/b", "a.off': that is a file. Choose another.") for dry in ("", "--dry-run")),
    ("visible a.off --out no/a.ply", "--out must be in a folder that exists; 'no' does not. Make it first."),
    ("visible a.off --out a.off/a.ply", "--out must be in a folder that exists; 'a.off' does not."),
    ("scan a.off --out no/a.ply", "--out must be in a folder that exists; 'no' does not. Make it first."),
    ("scan a.off --picture no/a.png --out a.ply", "--picture must be in a folder that exists; 'no' does not."),
    ("visible a.off --out a.xyz", "got 'a.xyz'"),
    ("scan a.off --out a.xyz", "--out must end in .ply, .npz, .pcd, .npy, .csv"),
    ("scan a.off --picture a.gif --out a.ply", "--picture must end in .png"),
    ("depth a.off --out a.jpg", "--out must end in .png, .npy, .exr"),
    ("sensors vlp-16 --picture a.gif", "must end in .png; got 'a.gif'"),
    ("views a.off --out a.txt --coverage", ".csv"),
    # cameras
    ("visible a.off --out a.ply --azimuth nan", "nan is not a finite number"),
    ("visible a.off --out a.ply --elevation nan", "--elevation"),
    ("visible a.off --out a.ply --elevation=91", "91.0 is not in the range -90<=x<=90"),
    ("visible a.off --out a.ply --distance nan", "--distance"),
    ("visible a.off --out a.ply --distance=0", "0.0 is not in the range x>0"),
    ("visible a.off --out a.ply --look-at nan 0 0", "nan is not a finite number"),
    ("visible a.off --out a.ply --fov nan", "nan is not a finite number"),
    ("visible a.off --out a.ply --method auto", "'auto' is for `generate` only. Name a method here"),
    ("visible a.off --out a.ply --with rgb", "attribute must be one of normals, colors; got 'rgb'"),
    ("visible a.off --out a.ply --cameras cameras.json --azimuth 4", "--azimuth must go without --cameras"),
    ("visible a.off --out a.ply --cameras cameras.json --distance 4 --roll 1", "--distance, --roll must go without"),
    ("visible a.off --out a.ply --cameras cameras.json --index 1", "--index must be below the 1 cameras of"),
    ("visible a.off --out a.ply --cameras cameras.json --union --index 0", "Leave one out"),
    ("visible a.off --out a.ply --index 3", "--index must go with --cameras"),
    ("visible a.off --out a.ply --union", "--union must go with --cameras"),
    ("visible a.off --out a.ply --sensor vlp-16", "is an option of `zbuf-occlude scan`"),
    ("visible a.off --out a.obj --points 9", "--points must go with a cloud"),
    ("visible a.off --out a.obj --method oracle", "--method must be exact"),
    ("views a.off --out a.png", "--coverage"),
    ("views a.off --order", "--order must go with --coverage"),
    ("views a.off --sensor vlp-16", "--sensor must go with --coverage"),
    ("views a.off --coverage --min-density 3", "--min-density must go with --sensor"),
    ("views a.off --coverage --sensor vlp-17", "Did you mean"),
    ("views a.off --views rng:3@2", "Did you mean 'ring'?"),
    ("views a.off --views random-so3:3 --out a.csv", "rolled"),
    ("views a.off --distance 3..2", "3..2"),
    # compare, and figures
    ("compare a.off --out o --distance 0", "it must be D or D0..D1"),
    ("compare a.off --out o --method auto", "'auto' is for `generate` only. Name a method here"),
    ("compare a.off --out o --method crystal_ball", "method must be one of"),
    ("compare a.off --out o --method occupancy_grid:", "--method must be NAME or NAME:KEY=VALUE"),
    ("compare a.off --out o --method occupancy_grid:cells=3", "got 'cells'"),
    ("compare a.off --out o --method occupancy_grid:n", "KEY=VALUE; got 'n'"),
    ("compare a.off --out o --method oracle --views nowhere", "views must be"),
    ("compare --out o --preset table1a --method exact", "--method must go with MESH_OR_DIR; table1a alone has"),
    ("compare --out o --preset scaling --points 9 --limit 2", "--points, --limit must go with MESH_OR_DIR"),
    ("compare --out o --modelnet .", "--modelnet must go with --preset table1a or table1b"),
    ("compare --out o --preset scaling --modelnet .", "--modelnet must go with --preset table1a or table1b"),
    ("compare-scans a.off a.off --out o --eye 0,0,1", "--look-at"),
    ("compare-scans a.off a.off --out o --eye 0,1 --look-at 0,0,0", "three finite numbers"),
    ("compare-scans a.off a.off --out o --up-axis 0,0,1", "--up-axis"),
    ("paper fig4 --method embree --out a.png", "No such option"),
    ("figure fig4 --out a.tiff", "--out must end in .png"),
    ("figure fig4 --method embree --out a.png", "fig4 does not use --method. Leave it out."),
    ("figure fig9 a.off --set a=1 --out a.png", "fig9 does not use"),
    ("figure fig10 --sydney . --out a.png", "fig10 does not use --sydney."),
    ("figure fig10 --up y --out a.png", "a built-in shape does not use --up."),
    # sensors and scans
    ("sensors --picture a.png", "--picture needs NAME"),
    ("sensors none.yaml", "a file must be readable"),
    ("scan a.off --out a.ply --azimuth nan", "nan is not a finite number"),
    ("scan a.off --out a.ply --elevation inf", "inf is not"),
    ("scan a.off --out a.ply --scene ground --elevation 40", "--elevation is for cameras"),
    ("scan a.off --out a.ply --scene gone.json", "a file must be readable; gone.json" + IN_WORDS),
    ("scan a.off --out a.ply --set-sensor lasers=3", "lasers of a sensor must be rows of 2 numbers"),
    ("scan a.off --out a.ply --set-sensor colums=3", "a number of the sensor vlp-32c must be one of"),
    ("scan a.off --out a.ply --set-sensor columns", "--set-sensor must be given KEY=VALUE; got 'columns'."),
    ("scan a.off --out a.ply --set-sensor sigma=1e300", "from 0 to 10000 metres; got 1e+300."),
    ("scan a.off --out a.ply --sensor vlp-17", "sensor must be one of vlp-16,"),
    ("scan a.off --out a.ply --sensor surface --range 5", "scan needs a sensor. `zbuf-occlude visible` writes"),
    ("scan a.off --out a.ply --range 0", "--range must be metres above 0"),
    ("scan a.off --out a.ply --range near", "--range must be a number, or two as A..B; got 'near'."),
    ("scan a.off --out a.ply --range 2 --size 4.5", "class a has 4.5 m, the range is 2 m."),
    ("scan a.off --out a.ply --size a=0", "--size must be 'file', metres from 0.001 to 100000, or CLASS=metres"),
    ("scan a.off --out a.ply --size 1,2", "each class once; got '1,2'"),
    ("scan a.off --out a.ply --set-sensor name=x", "a number of the sensor vlp-32c must be one of"),
    ("scan a.off --out a.ply --set-sensor self=1", "a number of the sensor vlp-32c must be one of"),
    ("scan a.off --out a.ply --size 1e-320", "--size must be 'file', metres from 0.001"),
    ("scan a.off --out a.ply --size banana=2", "--size must name classes of the meshes, a; got banana."),
    (
        "scan a.off --out a.ply",
        "every class must have a size in metres; 'a' has none. Give --size a=METRES, or --size METRES for all",
    ),
    ("scan a.off --out a.ply --hidden 0.2", "--hidden needs a scene that can hide"),
    ("scan a.off --out a.ply --velocity nan,0,0", "three finite numbers"),
    ("scan a.off --out a.ply --size 4 --scene ground --sensor-height -1", "above 0"),
    ("generate a.off --sensor vlp-16 --size 4 --range 9 --views cameras.json", "--range must go without cameras of"),
    (
        "generate a.off --sensor vlp-16 --points 100",
        "--points is for samples of the surface; it does not apply to a sensor.",
    ),
    ("generate --limit 2 --sensor vlp-16 --sample-size all --format scanobjectnn", "holds clouds of one size"),
    ("generate a.off --sensor vlp-16 --method vertex_hsr", "the method must cast rays; vertex_hsr does not"),
    ("generate a.off --sensor surface --range 9", "--range needs a sensor; give --sensor NAME."),
    ("generate a.off --sensor kinect-v1 --size 4 --turn 3", "no second camera"),
]


@pytest.mark.parametrize(("line", "said"), REFUSED)
def test_what_is_refused_is_one_line_and_leaves_nothing(run: Run, tmp_path: Path, line: str, said: str) -> None:
    write_off(tmp_path / "a.off", np.eye(3), np.array([[0, 1, 2]]))
    (tmp_path / "cameras.json").write_text(CAMERA)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    outcome = run(line, code=2)
    assert outcome.out == ""
    *others, last = outcome.err.splitlines()
    assert last.startswith("error: ")
    assert said in last
    assert "Errno" not in last
    assert last.count("gone.") <= 1, "a missing file is named once"
    assert not any(each.startswith(("error", "Error", "Usage")) for each in others)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("generate nowhere --method oracle --out o", "there is no such file or folder"),
        ("report .", "must hold a comparison's rows.jsonl"),
        ("show .", "it has no plan.json"),
        ("status .", "must hold a dataset; it has no plan.json"),
        ("merge .", "must hold a dataset; it has no plan.json"),
        (f"visible a.off --method oracle --points {10**26} --out a.ply", "n_points must be at most 2^31 - 1"),
    ],
)
def test_what_cannot_be_done_is_one_line(run: Run, tmp_path: Path, line: str, said: str) -> None:
    write_off(tmp_path / "a.off", np.eye(3), np.array([[0, 1, 2]]))
    outcome = run(line, code=1, says=said)
    assert outcome.out == ""
    assert outcome.err.splitlines()[-1].startswith("error: ")


def test_no_bar_begins_before_the_folder_is_refused(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.access", lambda *_, **__: True)  # as root sees it
    said = run("generate --limit 1 --views ring:1@0 --method exact --workers 1 --out /proc/foo", code=1)
    assert said.err.splitlines()[-1].startswith("error: ")
    assert "generate:" not in said.err


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_has_its_line_and_many_come_in_panels(
    run: Run, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "118")
    page = run(name, "--help").out
    rows = re.findall(r"^  (?:-\w, )?--[\w-]+.*$", page, re.MULTILINE)
    if len(rows) >= 10:
        panels = re.findall(r"^(\w+):$", page.partition("\nOptions:\n")[2], re.MULTILINE)
        assert {"Output", "Execution"} <= set(panels)
        assert len(panels) >= 3
    assert "INTEGER" not in page
    assert "x>=" not in page


@pytest.mark.usefixtures("modelnet")
def test_sizes_and_times_are_in_units_of_people(run: Run) -> None:
    outcome = run("generate meshes --method exact --views ring:2@20 --points 200 --dry-run")
    assert re.search(r"^about \S+ [kM]?B on disk; at most \S+ [kMG]?B while it works$", outcome.out, re.MULTILINE)
    assert re.search(r"^about \S+ (seconds|minutes) on one processor core, give or take ", outcome.out, re.MULTILINE)
    assert re.search(r"\(\S+ [kMGT]B free\)$", outcome.out, re.MULTILINE)
