"""The rules of the house, checked on every source file."""

import ast
import re
from functools import cache
from pathlib import Path
from statistics import median, quantiles
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("schemas", "physics", "twin", "stages", "pipeline")
SOURCES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
TEXTS = [
    path
    for folder in (*PACKAGES, "tests", "benchmarks", "docs", "logs", ".ci")
    for path in sorted((ROOT / folder).rglob("*"))
    if path.suffix in {".py", ".md", ".toml", ".msg", ".txt", ""} and path.is_file()
] + [ROOT / name for name in ("README.md", "Makefile", "pyproject.toml", "requirements.in")]

MAY_IMPORT = {
    "schemas": {"schemas"},
    "physics": {"physics"},
    "twin": {"twin", "physics", "schemas"},
    "stages": {"stages", "twin", "physics", "schemas"},
    "pipeline": set(PACKAGES),
}
MAY_IMPORT_STAGES = {"diagnose"}  # it re-runs the other stages
IMPURE = {"time", "datetime", "random", "logging", "subprocess", "socket", "requests"}
MAY_TOUCH_FILES = {"stages/publish", "stages/decode"}
LONGEST_FILE = 500

relative = [str(path.relative_to(ROOT)) for path in SOURCES]
every_source = pytest.mark.parametrize("path", SOURCES, ids=relative)


class Source(NamedTuple):
    """What the rules ask of a file, read once."""

    imported: list[str]
    called: list[str]
    functions: list[int]  # their lines


@cache
def source(path: Path) -> Source:
    nodes = list(ast.walk(ast.parse(path.read_text())))
    return Source(
        [name for node in nodes for name in imports(node, path)],
        [ast.unparse(node.func) for node in nodes if isinstance(node, ast.Call)],
        [length(node) for node in nodes if isinstance(node, ast.FunctionDef)],
    )


def imports(node: ast.AST, path: Path) -> list[str]:
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        assert node.level == 0, f"{path}: relative import"
        return [node.module or ""]
    return []


def length(node: ast.FunctionDef) -> int:
    body = node.body[1:] if ast.get_docstring(node) else node.body
    return (body[-1].end_lineno - body[0].lineno + 1) if body else 1


@every_source
def test_imports_run_downwards(path):
    package = path.relative_to(ROOT).parts[0]
    ours = {name.split(".")[0] for name in source(path).imported} & set(PACKAGES)
    assert ours <= MAY_IMPORT[package]


@pytest.mark.parametrize("path", [p for p in SOURCES if (ROOT / "stages") in p.parents], ids=str)
def test_a_stage_does_not_import_another_stage(path):
    folders = {folder.name for folder in (ROOT / "stages").iterdir() if folder.is_dir()}
    own = path.relative_to(ROOT).parts[1]
    others = {name.split(".")[1] for name in source(path).imported if name.startswith("stages.")} & folders - {own}
    assert own in MAY_IMPORT_STAGES or not others


@pytest.mark.parametrize("path", [p for p in SOURCES if p.relative_to(ROOT).parts[0] in {"physics", "twin", "stages"}])
def test_physics_twin_and_stages_have_no_clock_and_print_nothing(path):
    assert not {name.split(".")[0] for name in source(path).imported} & IMPURE
    assert not set(source(path).called) & {"print", "np.random.seed", "numpy.random.seed"}
    if "publish" not in path.parts:
        assert "rerun" not in {name.split(".")[0] for name in source(path).imported}


@pytest.mark.parametrize("path", [p for p in SOURCES if p.relative_to(ROOT).parts[0] in {"physics", "stages"}])
def test_only_decode_and_publish_open_files(path):
    folder = "/".join(path.relative_to(ROOT).parts[:2])
    if folder not in MAY_TOUCH_FILES:
        assert not [name for name in source(path).called if name == "open" or name.endswith((".open", ".write_text"))]


@every_source
def test_files_stay_short(path):
    assert len(path.read_text().splitlines()) <= LONGEST_FILE


def test_functions_stay_small():
    lengths = [lines for path in SOURCES for lines in source(path).functions]
    assert median(lengths) <= 9
    assert quantiles(lengths, n=10)[-1] <= 25


def test_nothing_is_left_unfinished_and_no_machine_is_named():
    unfinished = ("TO" + "DO", "FIX" + "ME", "NotImplemented" + "Error")
    machine = ("/wo" + "rk/", "/ro" + "ot/", "/o" + "pt/", "/tm" + "p/")
    pattern = re.compile("|".join(re.escape(word) for word in unfinished + machine))
    found = [f"{path}:{n}" for path in TEXTS for n, line in enumerate(read(path), 1) if pattern.search(line)]
    assert not found


def test_only_tests_know_of_material_beside_the_repository():
    outside = "../sha" + "red"
    others = [path for path in TEXTS if "tests" not in path.parts]
    assert not [path for path in others if any(outside in line for line in read(path))]


def read(path: Path) -> list[str]:
    return path.read_text(errors="replace").splitlines()
