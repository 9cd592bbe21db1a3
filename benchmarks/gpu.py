"""A GPU measured whole: right answers, speed, datasets by `generate`, cores, frames, memory.

    python benchmarks/gpu.py [PART ...] [--out build/gpu] [--small]

what     renderer, driver, EGL devices, memory, processors, packages; the device's own limits
right    depth_buffer with both refinements, exact_gl and warp against exact, by 8, 64 and 100 eyes; random scenes
fast     million point-views a second by faces, points and views, and where the time goes
job      400 mesh files x 100 views by `generate`: 1, 2, 4, 8 workers on one device, and how busy it is
cores    the same by exact alone, a thread a worker: speed-up, and the serial share
frames   640 x 480 pixels of depth, normals and faces, beside pyrender
soak     renders in 20 seconds: memory, answers; what a full device says

Without names: all, made to end within eight minutes beside a data-centre GPU with 16 cores; what would take longer is
left out and named. Each part runs in a process of its own and leaves PART.json in the folder of --out. One that is
there is not run again, unless it failed. In the end all that is there is told in gpu.md, which is printed too, and in
gpu.png (with matplotlib). Warp, PyTorch, embreex and pyrender are measured where they are installed. Meshes are those
of the folder ZBUF_OCCLUDE_DATA, or built-in shapes. Exit status 1 when a part failed.

--small: a look at whether all of it works, in a minute; a CPU may render. Otherwise only a GPU is measured.
"""

import json
import sys
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from datetime import date
from io import StringIO
from pathlib import Path
from typing import Any

from common import heads, row, run
from gpu_parts import PATIENCE, SMALL, WHOLE, Amount, cores, job, renderer_here, right, soak, what
from gpu_speed import fast, frames

from zbuf_occlude.base import atomic
from zbuf_occlude.base.child import ChildFailed, call_in_child
from zbuf_occlude.base.errors import GlError

Found = dict[str, Any]
PARTS: dict[str, Callable[[Amount], Found]] = {
    part.__name__: part for part in (what, right, fast, job, cores, frames, soak)
}


def main(*parts: str, out: Path = Path("build/gpu"), small: bool = False) -> int:
    try:
        renderer, software = call_in_child(renderer_here, timeout=PATIENCE)
    except (ChildFailed, GlError) as error:
        raise SystemExit(f"error: no OpenGL context opens: {error}") from None
    if software and not small:
        raise SystemExit(f"error: {renderer} is no GPU but a CPU; --small lets it render, for a look at the script.")
    out.mkdir(parents=True, exist_ok=True)
    failed = [name for name in parts or PARTS if not made(name, out, renderer, small)]
    records = {name: read(out, name) for name in PARTS if (out / f"{name}.json").exists()}
    text = StringIO()
    with redirect_stdout(text):
        report(records)
    (out / "gpu.md").write_text(text.getvalue(), encoding="utf-8")
    print(text.getvalue())
    draw({name: each["found"] for name, each in records.items() if "found" in each}, out / "gpu.png")
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return bool(failed)


def made(name: str, out: Path, renderer: str, small: bool) -> bool:
    """Run a part that is not there yet, write its file, and say whether it succeeded."""
    path, same = out / f"{name}.json", {"renderer": renderer, "small": small}
    if path.exists():
        known = read(out, name)
        if {key: known[key] for key in same} != same:
            kind = "--small" if known["small"] else "the whole"
            raise SystemExit(f"error: {path} is of {known['renderer']}, {kind}; take another folder, --out.")
        if "found" in known:
            return True
    began = time.perf_counter()
    record = {"part": name, **same, "date": date.today().isoformat()}
    try:
        record["found"] = call_in_child(PARTS[name], SMALL if small else WHOLE, timeout=PATIENCE)
    except Exception as error:  # whatever a driver or a package does, the other parts are run
        record["failure"] = f"{type(error).__name__}: {error}"
    record["seconds"] = round(time.perf_counter() - began, 1)
    atomic.write(path, lambda file: file.write(json.dumps(record, indent=1).encode()))
    print(f"{name}: {record['seconds']} s{'' if 'found' in record else ', failed'}", file=sys.stderr, flush=True)
    return "found" in record


def read(out: Path, name: str) -> Found:
    return json.loads((out / f"{name}.json").read_text(encoding="utf-8"))


# ---- tables ----------------------------------------------------------------------------------------------------------


def report(records: dict[str, Found]) -> None:
    """Print what the parts found, in Markdown."""
    tell = {"what": tell_what, "right": tell_right, "fast": tell_fast, "job": tell_job, "cores": tell_cores}
    tell |= {"frames": tell_frames, "soak": tell_soak}
    for name, record in records.items():
        print()
        if "found" in record:
            tell[name](record["found"])
        else:
            print(f"{name} failed: {record['failure']}")
        command = f"python benchmarks/gpu.py {name}{' --small' if record['small'] else ''}"
        print(f"\n(`{command}`, {record['date']}, {record['seconds']:.0f} s, {record['renderer']})")


def tell_what(found: Found) -> None:
    cards = "; ".join(f"{name}, driver {driver}, {float(memory):,.0f} MiB" for name, driver, memory in found["cards"])
    print(f"{found['renderer']}, OpenGL {found['version']}{f' ({cards})' if cards else ''}; {found['processor']}\n")
    limits = found["limits"]
    heads(*limits, words=0)
    row(*(short(value) for value in limits.values()))
    print()
    heads("device", "renderer", "CUDA", "works", words=4)
    for each in found["devices"]:
        device = each["backend"] if each["device_index"] is None else f"{each['backend']} {each['device_index']}"
        cuda = "-" if each["cuda_device"] is None else each["cuda_device"]
        row(device, each["renderer"] or "-", cuda, "yes" if each["works"] else each["reason"])
    print(f"\n{', '.join(f'{name} {version}' for name, version in found['packages'].items())}")


def tell_right(found: Found) -> None:
    print(f"{len(found['meshes'])} meshes, against `exact`\n")
    columns = "wrong", "outside the band", "a dataset's check states", "pairs that differ between batches"
    heads("method", "pairs", *columns)
    for name, each in found["rows"].items():
        shares = (f"{short(100 * each[key] / each['pairs'])} %" for key in ("wrong", "outside"))
        stated = " to ".join(short(100 * share) for share in each["stated"]) + " %" if each["stated"] else "-"
        row(name, f"{each['pairs']:,}", *shares, stated, each["otherwise in another batch"])
    print()
    heads("random scenes against rational arithmetic", "scenes", "pairs", "wrong")
    for name, each in found["scenes"].items():
        row(f"`{name}`", f"{each['scenes']:,}", f"{each['pairs']:,}", each["wrong"])


def tell_fast(found: Found) -> None:
    subjects = list(dict.fromkeys(each["subject"] for each in found["rows"]))
    print(
        "Million point-views a second, the points already uploaded (in brackets: the first call, which uploads them)\n"
    )
    heads("faces, points, views", *subjects)
    for place, cell in cells_of(found).items():
        cells = []
        for subject in subjects:
            each = cell.get(subject)
            first = f" ({short(each['rate'] * each['again'] / each['first'])})" if each and "first" in each else ""
            cells.append(f"{short(each['rate'])}{first}" if each else "-")
        row(", ".join(f"{n:,}" for n in place), *cells)
    print("\nMilliseconds of a first call, the device waited for after each step\n")
    steps = ("upload", "draw", "test", "transfer", "unpack", "else")
    heads("faces, points, views", "method", *steps, "million triangles a second", words=2)
    for each in found["stages"]:
        spent = each["stages"]
        drawn = short(each["faces"] * each["views"] / spent["draw"] / 1e6) if spent.get("draw") else "-"
        cells = (short(1e3 * spent[step]) if step in spent else "-" for step in steps)
        row(f"{each['faces']:,}, {each['points']:,}, {each['views']:,}", each["subject"], *cells, drawn)
    if "warp, tensors" in subjects:
        print("\n`warp, tensors` leaves its answers on the device; all others bring them to the host.")
    tell_left_out(found)


def cells_of(found: Found) -> dict[tuple[int, int, int], Found]:
    """Return the rows of speed by faces, points and views, and then by subject, in order."""
    cells: dict[tuple[int, int, int], Found] = {}
    for each in found["rows"]:
        cells.setdefault((each["faces"], each["points"], each["views"]), {})[each["subject"]] = each
    return dict(sorted(cells.items()))


def tell_job(found: Found) -> None:
    print(
        f"{found['meshes']}, {found['clouds']:,} clouds of 1,024 of 10,000 points, by whole processes of `generate`\n"
    )
    heads(
        "method",
        "workers",
        "seconds",
        "processors' seconds",
        "clouds a second",
        "MB of a process",
        "GPU busy",
        "GPU MB",
    )
    for each in found["rows"]:
        busy = f"{each['gpu_busy']:.0f} %" if "gpu_busy" in each else "-"
        memory = f"{each['gpu_megabytes']:,.0f}" if "gpu_megabytes" in each else "-"
        rate = f"{found['clouds'] / each['clock']:,.0f}"
        cost = (f"{each['clock']:.1f}", f"{each['processors']:.1f}", rate, f"{each['megabytes']:.0f}")
        row(f"`{each['method']}`", each["workers"], *cost, busy, memory)
    tell_left_out(found)


def tell_cores(found: Found) -> None:
    print(f"`exact`, {found['meshes']}, {found['clouds']:,} clouds of 1,024 of 10,000 points, a thread a worker\n")
    heads("workers", "seconds", "processors' seconds", "times as fast", words=0)
    slowest = max(found["rows"], key=lambda each: -each["workers"])
    for each in found["rows"]:
        faster = f"{slowest['clock'] / each['clock']:.1f}"
        row(each["workers"], f"{each['clock']:.1f}", f"{each['processors']:.1f}", faster)
    if "serial_share" in found:
        print(f"\nBy Amdahl's law {found['serial_share']:.1%} is serial, {found['serial_seconds']:.1f} s.")
    tell_left_out(found)


def tell_left_out(found: Found) -> None:
    if found["left_out"]:
        print(f"\nLeft out, for time: {'; '.join(found['left_out'])}.")


def tell_frames(found: Found) -> None:
    print(f"Frames of {found['width']} x {found['height']} a second: depth, normals, faces\n")
    names = list(found["rows"][0]["rate"])
    heads("faces", *names, "pixels where depth_buffer finds the same face as exact", words=0)
    for each in found["rows"]:
        row(f"{each['faces']:,}", *(short(each["rate"][name]) for name in names), f"{each['same_faces']:.3%}")
    if found["pyrender"]:
        print(f"\npyrender renders by {found['pyrender']}.")


def tell_soak(found: Found) -> None:
    flat = "flat" if found["growth"] <= found["allowed"] else "not flat"
    flat = flat if found["enough"] else "not judged, for too few renders"
    print(f"{found['renders']:,} renders; answers that differ: {found['different']}; ", end="")
    print(f"memory of the host {flat}: {found['megabytes']:.0f} MB, {found['growth']:+.1%} after warm-up.")
    if any(found["device_megabytes"]):
        print("Memory of the device: {:,.0f} MB at first, {:,.0f} MB at most.".format(*found["device_megabytes"]))
    print(f"\nA full device: {found['full'] or 'it could not be filled.'}")


def short(value: float) -> str:
    """Write a number with three digits that count."""
    return f"{float(f'{value:.3g}'):,.10g}"


# ---- picture ---------------------------------------------------------------------------------------------------------


def draw(found: dict[str, Found], out: Path) -> None:
    """Draw speed by faces, points and views, and the clock of whole jobs; without matplotlib there is no picture."""
    try:
        from zbuf_occlude.drawing.pictures import canvas
    except ImportError as error:
        print(f"no picture: {error}", file=sys.stderr)
        return
    figure, panels = canvas(17.0, 4.6, 4)
    if "fast" in found:
        cells, middle = cells_of(found["fast"]), found["fast"]["middle"]
        subjects = list(dict.fromkeys(each["subject"] for each in found["fast"]["rows"]))
        for axis, name in enumerate(("faces", "points", "views")):
            others = [i for i in range(3) if i != axis]
            on_axis = {at[axis]: cell for at, cell in cells.items() if all(at[i] == middle[i] for i in others)}
            for number, subject in enumerate(subjects):
                line = [(size, cell[subject]["rate"]) for size, cell in on_axis.items() if subject in cell]
                style = {"color": f"C{number}", "linestyle": "--" if number > 4 else "-"}
                panels[axis].loglog(*zip(*line, strict=True), "o", markersize=3.5, label=subject, **style)
            fixed = ", ".join(f"{middle[i]:,} {('faces', 'points', 'views')[i]}" for i in others)
            panels[axis].set_title(f"million point-views a second\n{fixed}", fontsize=10)
            panels[axis].set_xlabel(name)
        panels[0].legend(fontsize=7)
    for rows, subject in ((found.get("job", {}), ""), (found.get("cores", {}), ", a thread a worker")):
        clocks: dict[str, list[tuple[int, float]]] = {}
        for each in rows.get("rows", []):
            clocks.setdefault(f"{each['method']}{subject}", []).append((each["workers"], each["clock"]))
        for name, line in clocks.items():
            panels[3].loglog(*zip(*line, strict=True), "o-", markersize=3.5, label=name)
    for panel in panels:
        panel.tick_params(which="both", labelsize=8)
        panel.xaxis.set_minor_formatter("")
    for formatted in (panels[3].yaxis.set_major_formatter, panels[3].yaxis.set_minor_formatter):
        formatted("{x:g}")
    panels[3].set_title("seconds of a whole job", fontsize=10)
    panels[3].set_xlabel("workers")
    if panels[3].lines:
        panels[3].set_xticks(sorted({x for line in panels[3].lines for x in line.get_xdata()}))
        panels[3].xaxis.set_major_formatter("{x:g}")
        panels[3].legend(fontsize=7)
    figure.savefig(out, dpi=110)


if __name__ == "__main__":
    run(main, __doc__, parts=PARTS)
