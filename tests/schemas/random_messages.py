"""Random message definitions with values, as hypothesis strategies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hypothesis import strategies as st

from tests.oracles.cdr import CODES, Encoder

# Other implementations disagree on the sign of byte and char, so values up to 127 here.
INTEGERS = {"byte": (0, 127), "char": (0, 127)}
INTEGERS |= {f"int{b}": (-(2 ** (b - 1)), 2 ** (b - 1) - 1) for b in (8, 16, 32, 64)}
INTEGERS |= {f"uint{b}": (0, 2**b - 1) for b in (8, 16, 32, 64)}


@dataclass(frozen=True)
class Sample:
    """A definition, its kinds for the oracle, and values of some messages."""

    text: str
    kinds: list[tuple[str, Any]]
    values: list[dict[str, Any]]

    def payloads(self, order: str) -> list[bytes]:
        done = []
        for value in self.values:
            encoder = Encoder(order)
            encoder.value(self.kinds, value)
            done.append(encoder.bytes())
        return done


def values_of(kind: Any) -> st.SearchStrategy[Any]:
    if isinstance(kind, list):
        return st.fixed_dictionaries({name: values_of(inner) for name, inner in kind})
    if isinstance(kind, tuple):
        size = {"min_size": 0, "max_size": 3} if kind[0] == "sequence" else {"min_size": kind[2], "max_size": kind[2]}
        return st.lists(values_of(kind[1]), **size)
    if kind == "string":
        return st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=9)
    if kind == "bool":
        return st.booleans()
    if kind in INTEGERS:
        return st.integers(*INTEGERS[kind])
    return st.floats(width=32 if kind == "float32" else 64, allow_nan=False)


@st.composite
def samples(draw: st.DrawFn, *, nested: bool = True) -> Sample:
    """One to six messages of a random type with at most one nested type."""
    inner_text, inner_kinds = draw(_members("b", ()))
    outer_text, outer_kinds = draw(_members("a", inner_kinds if nested else ()))
    text = f"# a comment\nint32 LIMIT=5\n{outer_text}{'=' * 80}\nMSG: pkg/Inner\n{inner_text}"
    values = draw(st.lists(values_of(outer_kinds), min_size=1, max_size=6))
    return Sample(text, outer_kinds, values)


@st.composite
def _members(draw: st.DrawFn, letter: str, inner: Any) -> tuple[str, list[tuple[str, Any]]]:
    bases = [*CODES, "string"] + (["Inner"] * 6 if inner else [])
    lines, kinds = [], []
    for k, base in enumerate(draw(st.lists(st.sampled_from(bases), min_size=1, max_size=5))):
        kind = inner if base == "Inner" else base
        form = draw(st.sampled_from(["", "", "array", "sequence", "bounded"]))
        size = draw(st.integers(1, 3))
        suffix = {"": "", "array": f"[{size}]", "sequence": "[]", "bounded": "[<=3]"}[form]
        lines.append(f"{base}{suffix} {letter}{k}\n")
        if form:
            kind = ("array", kind, size) if form == "array" else ("sequence", kind)
        kinds.append((f"{letter}{k}", kind))
    return "".join(lines), kinds
