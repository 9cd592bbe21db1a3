"""Functions are compiled when they are called, and kept for the state of the sources they were compiled of."""

import ast
import gc
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba import njit as njit_of_numba

from zbuf_occlude.base.jit import compiler
from zbuf_occlude.base.jit.compiler import CACHE_KEY_FOLDERS, njit

ROOT = Path(__file__).parents[3]
NOWHERE = "/dev/null"  # no folder, and nothing can be made in it, by root neither


@njit(inline="always")
def twice(number):
    """Two of it."""
    return number + number


@njit()
def four_times(number):
    return twice(twice(number))


@njit_of_numba
def eight_times(number):
    return twice(four_times(number))


def test_kernels_call_kernels_and_numbas_own_call_them() -> None:
    assert eight_times(3) == 24
    assert four_times(3.5) == 14.0
    assert len(four_times.signatures) == 2  # one for whole numbers, compiled with `eight_times`, one for others
    assert (twice.__name__, twice.__doc__) == ("twice", "Two of it.")


def run(program: str, *, cwd: Path = ROOT, **environment: str) -> str:
    line = [sys.executable, "-B", "-c", program]
    variables = {**os.environ, **environment}
    child = subprocess.run(line, cwd=cwd, env=variables, capture_output=True, text=True, check=False)
    assert child.returncode == 0, child.stderr
    return child.stdout.strip()


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """The module under test, and a function that calls one of another file, which has a constant of a third."""
    folder = tmp_path / "package"
    (folder / "base" / "jit").mkdir(parents=True)
    shutil.copy(compiler.__file__, folder / "base" / "jit")
    names = "from package.base.jit.compiler import njit\n"
    (folder / "base" / "caller.py").write_text(
        f"{names}from package.base.callee import answer\n@njit(cache=True)\ndef ask():\n    return answer()\n"
    )
    (folder / "base" / "callee.py").write_text(
        f"{names}from package.base.constants import ANSWER\n@njit()\ndef answer():\n    return ANSWER\n"
    )
    (folder / "base" / "constants.py").write_text("ANSWER = 1\n")
    return folder


ASK = (
    "from package.base.jit.compiler import cache_folder\n"
    "from package.base.caller import ask\n"
    "print(ask(), sum(ask.stats.cache_hits.values()), cache_folder())\n"
)
"""Prints the answer, whether the function was found compiled, and in which folder."""


def says(package: Path, **environment: str) -> list[str]:
    return run(ASK, cwd=package.parent, **{"NUMBA_CACHE_DIR": "", **environment}).split()


def test_a_change_of_any_source_compiles_anew_and_removes_what_was(package: Path) -> None:
    first = says(package)
    assert first[:2] == ["1", "0"]
    assert Path(first[2]).parent == package / "__pycache__"
    assert says(package) == ["1", "1", first[2]]
    (package / "base" / "constants.py").write_text("ANSWER = 22\n")
    again = says(package)
    assert again[:2] == ["22", "0"]
    assert Path(again[2]).is_dir()
    assert not Path(first[2]).exists()


def test_where_nothing_of_the_package_can_be_written(package: Path) -> None:
    """Another place is found; where there is none at all, functions are compiled all the same."""
    (package / "__pycache__").write_text("no folder")
    at_home = says(package, XDG_CACHE_HOME=str(package.parent / "home"))
    assert Path(at_home[2]).parent == package.parent / "home" / "zbuf_occlude"
    private = says(package, XDG_CACHE_HOME=NOWHERE, TMPDIR=str(package.parent))
    assert Path(private[2]).parents[1] == package.parent
    assert says(package, XDG_CACHE_HOME=NOWHERE, TMPDIR=str(package.parent)) == ["1", "1", private[2]]
    Path(private[2]).parent.chmod(0o755)  # somebody else could have written there
    assert says(package, XDG_CACHE_HOME=NOWHERE, TMPDIR=str(package.parent)) == ["1", "0", "None"]


SAYS = "import logging, sys\nlogging.basicConfig(format='SAID %(message)s', stream=sys.stdout)\n"


def test_compiling_is_said_where_something_is_compiled_only(package: Path) -> None:
    """Once in a cache; not each time for the first place, which may not be written."""
    (package / "__pycache__").write_text("no folder")

    def said(**environment: str) -> str:
        return run(SAYS + ASK, cwd=package.parent, NUMBA_CACHE_DIR="", **environment)

    home = str(package.parent / "home")
    assert [said(XDG_CACHE_HOME=home).count("SAID compiling, once") for _ in range(2)] == [1, 0]


def test_no_folder_is_made_where_a_person_is(package: Path) -> None:
    """Of a user whom the system does not know, and who has no HOME, "~" stays as it is; relative names are no homes."""
    (package / "__pycache__").write_text("no folder")
    program = f"import os, pwd\npwd.getpwuid = lambda user: {{}}[user]\nos.environ.pop('HOME', None)\n{ASK}"
    found = run(program, cwd=package.parent, NUMBA_CACHE_DIR="", XDG_CACHE_HOME="cache", TMPDIR=str(package.parent))
    assert Path(found.split()[2]).is_absolute()
    assert not (package.parent / "~").exists()
    assert not (package.parent / "cache").exists()


def test_who_asks_hears_of_each_function_that_is_compiled() -> None:
    heard: list[int] = []
    compiler.on_compiled(lambda: heard.append(1))

    @njit()
    def half(number):
        return number / 2.0

    assert [half(3.0), half(5.0), len(heard)] == [1.5, 2.5, 1]
    assert [half(3), len(heard)] == [1.5, 2]


def test_processes_that_compile_at_the_same_time_all_answer(package: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(package.parent / "cache")}
    asking = [
        subprocess.Popen([sys.executable, "-c", ASK], cwd=package.parent, env=environment, stdout=subprocess.PIPE)
        for _ in range(3)
    ]
    assert [child.communicate()[0].split()[0] for child in asking] == [b"1"] * 3
    found, folder = says(package, NUMBA_CACHE_DIR=str(package.parent / "cache"))[1:]
    assert (found, Path(folder).parent) == ("1", package.parent / "cache")


def test_a_job_is_noted_as_compiled_until_a_source_changes(package: Path) -> None:
    program = (
        "from package.base.jit.compiler import compiled_before, note_compiled as note\n{}print(compiled_before('job'))"
    )

    def known(before: str = "") -> str:
        return run(program.format(before), cwd=package.parent, NUMBA_CACHE_DIR=str(package.parent / "cache"))

    assert [known(), known("note('job')\n"), known(), known("note('another')\n")] == ["False", "True", "True", "True"]
    elsewhere = "from package.base.jit.compiler import compiled_before\nprint(compiled_before('job'))"
    other = str(package.parent / "other")  # code of one folder is no use to who keeps his in another
    assert run(elsewhere, cwd=package.parent, NUMBA_CACHE_DIR=other) == "False"
    run(program.format("note('job')\n"), cwd=package.parent, NUMBA_CACHE_DIR="")
    assert run(elsewhere, cwd=package.parent, NUMBA_CACHE_DIR=other) == "False"
    (package / "base" / "constants.py").write_text("ANSWER = 22\n")
    assert known() == "False"


def is_kernel(node: ast.FunctionDef) -> bool:
    words = ("njit", "device_function", "always_inline", "inline_ir", "parallel_kernel")
    return any(ast.unparse(decorator).startswith(words) for decorator in node.decorator_list)


def imported_by_kernels(tree: ast.Module) -> set[str]:
    """Return the modules of which compiled functions use something."""
    functions = [node for node in tree.body if isinstance(node, ast.FunctionDef) and is_kernel(node)]
    used = {node.id for function in functions for node in ast.walk(function) if isinstance(node, ast.Name)}
    froms = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    return {str(node.module) for node in froms if used & {alias.name for alias in node.names}}


def test_what_compiled_functions_are_made_of_is_part_of_the_state() -> None:
    """A constant of a file elsewhere could change, and functions compiled with it stay."""
    hashed = {path for room in CACHE_KEY_FOLDERS for path in (ROOT / "zbuf_occlude" / room).glob("*.py")}
    looked_at = 0
    for path in sorted((ROOT / "zbuf_occlude").rglob("*.py")):
        modules = imported_by_kernels(ast.parse(path.read_text(encoding="utf-8")))
        looked_at += bool(modules)
        files = {ROOT / (module.replace(".", "/") + ".py") for module in modules}
        assert {file for file in files if file.exists()} <= hashed, path
    assert looked_at > 20


def test_asking_what_is_compiled_makes_no_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """So the server of workers, which asks, does not say beside the command that it compiles."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert not compiler.compiled_before("a job that nobody noted")
    assert not list(tmp_path.iterdir())
    monkeypatch.setenv("NUMBA_CACHE_DIR", "x" * 300)
    assert not compiler.compiled_before("a job that nobody noted"), "a place that cannot be looked at"


EXTERNALS = """
from package import gate
from package.base.jit.compiler import external, njit
@external("float64(float64)")
def outer(x):
    return more(x)
gate.pause()
@njit()
def more(x):
    return x + 1.0
@njit(cache=True)
def call(x):
    return outer(x)
"""
GATE = (
    "import threading\nbegun, go = threading.Event(), threading.Event()\ndef pause():\n    begun.set(), go.wait(60)\n"
)


def test_a_thread_calls_functions_while_another_imports_external_ones(package: Path) -> None:
    """A function of a module that is half imported lacks those that it calls."""
    (package / "externals.py").write_text(EXTERNALS)
    (package / "gate.py").write_text(GATE)
    program = (
        "import importlib, threading\n"
        "from package import gate\n"
        "from package.base.callee import answer\n"
        "other = threading.Thread(target=importlib.import_module, args=['package.externals'])\n"
        "other.start(), gate.begun.wait(60)\n"
        "print(answer())\n"
        "gate.go.set(), other.join()\n"
        "from package.externals import call\n"
        "print(call(1.0))\n"
    )
    assert run(program, cwd=package.parent, NUMBA_CACHE_DIR="").split() == ["1", "2.0"]


@pytest.mark.parametrize(
    ("caller", "answer"),
    [("inner_first", "6.0"), ("outer_first", "2.0"), ("by_closure", "2.0"), ("by_nested", "2.0"), ("by_module", "2.0")],
)
def test_external_functions_are_there_for_what_is_read_from_the_cache(package: Path, caller: str, answer: str) -> None:
    (package / "externals.py").write_text(
        "from package.base.jit.compiler import external, njit\n"
        "@external('float64(float64)')\ndef inner(x):\n    return x + 1.0\n"
        "@njit()\ndef between(x):\n    return inner(x)\n"
        "@external('float64(float64)')\ndef outer(x):\n    return between(x) * 2.0\n"
        "@external('float64(float64)')\ndef unused(x):\n    return x\n"
        "@njit(cache=True)\ndef inner_first(x):\n    return inner(x) + outer(x)\n"
        "@njit(cache=True)\ndef outer_first(x):\n    return outer(x) - inner(x)\n"
        "def made(called):\n    return njit()(lambda x: called(x))\n"
        "in_closure = made(inner)\n"
        "@njit(cache=True)\ndef by_closure(x):\n    return in_closure(x)\n"
        "@njit(cache=True)\ndef by_nested(x):\n    def within(y):\n        return inner(y)\n    return within(x)\n"
        "from package import externals\n"
        "@njit(cache=True)\ndef by_module(x):\n    return externals.inner(x)\n"
    )
    program = (
        "import sys\n"
        "from package import externals\n"
        "caller = getattr(externals, sys.argv[1])\n"
        "print(caller(1.0), '_numba_type_' in vars(externals.unused), sum(caller.stats.cache_hits.values()))"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(package.parent / "cache")}
    command, called = [sys.executable, "-c", program], {"cwd": package.parent, "env": environment, "text": True}
    for n_read in (0, 1):
        found = subprocess.run([*command, caller], capture_output=True, check=True, **called).stdout.split()
        assert found == [answer, "False", str(n_read)]


def test_threads_that_declare_functions_leave_numbas_cache_folder(package: Path) -> None:
    """One defines an external function, while another declares a function that is cached."""
    (package / "externals.py").write_text(EXTERNALS.replace("more(x)", "x + 1.0", 1))
    (package / "gate.py").write_text("def pause(): pass\n")
    program = (
        "import numba, threading\n"
        "from package.base.jit import compiler\n"
        "defining, declaring, defined = (threading.Event() for _ in range(3))\n"
        "folder, cfunc, njit = compiler.cache_folder(), numba.cfunc, numba.njit\n"
        "def late_folder():\n"
        "    if threading.current_thread() is other: declaring.set(), defining.wait(60)\n"
        "    return folder\n"
        "def slow_cfunc(*given, **options):\n"
        "    defining.set(), inside.wait(2)\n"
        "    return cfunc(*given, **options)\n"
        "def slow_njit(*given, **options):\n"
        "    if threading.current_thread() is other: inside.set(), defined.wait(60)\n"
        "    return njit(*given, **options)\n"
        "inside = threading.Event()\n"
        "compiler.cache_folder, numba.cfunc, numba.njit = late_folder, slow_cfunc, slow_njit\n"
        "before = numba.config.CACHE_DIR\n"
        "from package.base.caller import ask\n"
        "other = threading.Thread(target=ask)\n"
        "other.start(), declaring.wait(60)\n"
        "from package.externals import call\n"
        "call._declared()\n"
        "defined.set(), other.join()\n"
        "print(numba.config.CACHE_DIR == before, call(1.0))\n"
    )
    assert run(program, cwd=package.parent, NUMBA_CACHE_DIR="").split() == ["True", "2.0"]


def test_of_two_processes_at_a_function_one_compiles_it_and_the_other_loads_it(package: Path) -> None:
    (package / "base" / "callee.py").write_text(
        "from package.base.jit.compiler import njit\n@njit()\ndef answer():\n"
        + "".join(f"    x{i} = {i} * {i}\n" for i in range(150))  # takes a while
        + "    return 1\n"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(package.parent / "cache")}
    asking = [
        subprocess.Popen([sys.executable, "-c", ASK], cwd=package.parent, env=environment, stdout=subprocess.PIPE)
        for _ in range(2)
    ]
    found = sorted(child.communicate()[0].split()[1] for child in asking)
    assert found == [b"0", b"1"]


def test_an_interrupt_while_code_is_loaded_is_raised_afterwards(package: Path) -> None:
    """LLVM calls Python meanwhile, where an exception would be printed and lost."""
    program = (
        "import signal\n"
        "from numba.core import caching\n"
        "from package.base.caller import ask\n"
        "load, loaded = caching.FunctionCache.load_overload, []\n"
        "def interrupted(*given):\n"
        "    signal.raise_signal(signal.SIGINT)\n"
        "    loaded.append(load(*given) is not None)\n"
        "caching.FunctionCache.load_overload = interrupted\n"
        "try: ask()\n"
        "except KeyboardInterrupt: print(loaded)\n"
    )
    cache = str(package.parent / "cache")
    assert run(ASK, cwd=package.parent, NUMBA_CACHE_DIR=cache).split()[0] == "1"
    assert run(program, cwd=package.parent, NUMBA_CACHE_DIR=cache) == "[True]"


def test_waiting_for_a_lock_ends(package: Path) -> None:
    program = (
        "import fcntl\n"
        "from package.base.caller import ask\n"
        "from package.base.jit import compiler\n"
        "compiler.PATIENCE = 0.1\n"
        "held = compiler._lock_of(ask)\n"
        "print(ask())"
    )
    assert run(program, cwd=package.parent, NUMBA_CACHE_DIR=str(package.parent / "cache")) == "1"


def test_what_is_compiled_is_loaded_without_a_lock(package: Path) -> None:
    cache = str(package.parent / "cache")
    assert says(package, NUMBA_CACHE_DIR=cache)[1] == "0"
    program = "import fcntl\ndef refuse(*given): raise AssertionError('a lock was taken')\nfcntl.flock = refuse\n"
    assert run(program + ASK, cwd=package.parent, NUMBA_CACHE_DIR=cache).split()[1] == "1"


def test_threads_that_compile_at_once_leave_the_garbage_collector_on(package: Path) -> None:
    program = (
        "import gc, threading\n"
        "from package.base.caller import ask\n"
        "threads = [threading.Thread(target=ask) for _ in range(3)]\n"
        "[thread.start() for thread in threads], [thread.join() for thread in threads]\n"
        "print(gc.isenabled(), ask())"
    )
    assert run(program, cwd=package.parent, NUMBA_CACHE_DIR=str(package.parent / "cache")) == "True 1"


def test_where_compiled_code_cannot_be_kept_the_answer_comes_all_the_same(package: Path) -> None:
    (package / "externals.py").write_text(EXTERNALS)
    (package / "gate.py").write_text("def pause(): pass\n")
    program = (
        "from numba.core import caching\n"
        "def refuse(*given): raise OSError(28, 'No space left on device')\n"
        "caching.IndexDataCacheFile.save = refuse\n"
        "from package.base.caller import ask\n"
        "from package.externals import call\n"
        "print(ask(), call(1.0), ask.is_kept)"
    )
    assert run(program, cwd=package.parent, NUMBA_CACHE_DIR=str(package.parent / "cache")) == "1 2.0 False"


def test_the_garbage_collector_is_as_it_was_after_compiling() -> None:
    for enabled in (True, False):
        (gc.enable if enabled else gc.disable)()

        @njit()
        def third(number):
            return number / 3.0

        assert third(3.0) == 1.0
        assert gc.isenabled() == enabled
    gc.enable()


def test_where_nothing_can_be_kept_threads_nested_functions_and_other_types_get_their_answers(package: Path) -> None:
    (package / "base" / "nested.py").write_text(
        "from package.base.jit.compiler import njit\n"
        "@njit(cache=True)\ndef inner(x):\n    return x + 1\n"
        "@njit(cache=True)\ndef outer(x):\n    return 2 * inner(x)\n"
    )
    program = (
        "import threading\n"
        "from numba.core import caching\n"
        "def refuse(*given): raise OSError(28, 'No space left on device')\n"
        "caching.IndexDataCacheFile.save = refuse\n"
        "from package.base.nested import inner, outer\n"
        "found = []\n"
        "threads = [threading.Thread(target=lambda: found.append(outer(1))) for _ in range(2)]\n"
        "[thread.start() for thread in threads], [thread.join() for thread in threads]\n"
        "print(*found, outer(0.5), inner.is_kept, outer.is_kept)"
    )
    found = run(program, cwd=package.parent, NUMBA_CACHE_DIR=str(package.parent / "cache"))
    assert found == "4 4 3.0 False False"
