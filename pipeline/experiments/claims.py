"""Claims about measured figures, as experiments state them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from schemas.experiment import Check, Figures, Values


def at_most(claim: str, case: str, method: str, quantity: str, bound: Values) -> Check:
    """The mean stays below a bound, axis by axis."""

    def verdict(figures: Figures) -> tuple[bool, str]:
        found = figures.get((case, method, quantity))
        if found is None:
            return False, "not measured"
        return bool(np.all(np.array(found.mean) <= bound)), shown(found.mean)

    return Check(claim, verdict)


def ordered(claim: str, case: str, methods: Sequence[str], quantity: str) -> Check:
    """Each method's mean is worse than the one before, on every axis."""

    def verdict(figures: Figures) -> tuple[bool, str]:
        found = [figures[case, method, quantity] for method in methods if (case, method, quantity) in figures]
        means = np.array([figure.mean for figure in found])
        text = "; ".join(f"{figure.method} {shown(figure.mean)}" for figure in found)
        return len(found) == len(methods) and bool(np.all(np.diff(means, axis=0) > 0)), text

    return Check(claim, verdict)


def within_factor(claim: str, better: tuple[str, str, str], worse: tuple[str, str, str], factor: float) -> Check:
    """One figure is at most ``factor`` times another, axis by axis. Figures by case, method, quantity."""

    def verdict(figures: Figures) -> tuple[bool, str]:
        if better not in figures or worse not in figures:
            return False, "not measured"
        ratio = np.array(figures[worse].mean) / np.array(figures[better].mean)
        return bool(np.all(ratio <= factor)), f"ratio {shown(tuple(ratio))}"

    return Check(claim, verdict)


def beats(claim: str, case: str, ours: str, methods: Sequence[str], quantity: str) -> Check:
    """Ours is better than every method as run here, on every axis; says by how much, at least."""

    def verdict(figures: Figures) -> tuple[bool, str]:
        own = figures.get((case, ours, quantity))
        found = [figures[case, method, quantity] for method in methods if (case, method, quantity) in figures]
        if own is None or not found:
            return False, "not measured"
        ratios = np.array([np.array(figure.mean) / own.mean for figure in found])
        least = tuple(float(v) for v in ratios.min(axis=0))
        return bool(np.all(ratios > 1.0)), f"at least {shown(least)} times"

    return Check(claim, verdict)


def published_over(claim: str, own: tuple[str, str, str], published: tuple[str, str, str], ratio: Values) -> Check:
    """The published figure over our mean is at least ``ratio`` (NaN: not printed), axis by axis."""

    def verdict(figures: Figures) -> tuple[bool, str]:
        printed = figures[published].printed if published in figures else None
        if own not in figures or printed is None:
            return False, "not measured"
        found = np.array(printed.value) / np.array(figures[own].mean)
        asked = np.isfinite(ratio) & np.isfinite(found)
        return bool(np.all(found[asked] >= np.array(ratio)[asked])), f"{shown(tuple(found))} times"

    return Check(claim, verdict)


def shown(values: Values, digits: int = 2) -> str:
    """Figures side by side to so many digits, a dash where there is none."""
    return " ".join(_digits(value, digits) for value in values)


def _digits(value: float, digits: int) -> str:
    if not np.isfinite(value):
        return "–"
    text = f"{value:.{digits}g}"
    return f"{value:.0f}" if "e" in text and abs(value) >= 1.0 else text
