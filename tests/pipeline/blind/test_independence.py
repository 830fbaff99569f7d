"""The reality behind the seal shares no forward model with the library."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[3]
ALLOWED = {"physics.earth", "physics.units", "twin.config", "schemas.trial"}


def imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module == "physics":
            names |= {f"physics.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module or "")
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return names


def test_it_takes_only_the_data_model_the_earth_and_units_from_the_project():
    own = {"physics", "twin", "stages", "schemas", "pipeline"}
    files = sorted((ROOT / "pipeline" / "blind" / "reality").glob("*.py"))
    assert len(files) > 8
    for path in files:
        ours = {name for name in imported(path) if name.split(".")[0] in own}
        assert {name for name in ours if not name.startswith("pipeline.blind.reality")} <= ALLOWED, path
