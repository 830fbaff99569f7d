"""The page of the documentation that lists all effects: ``python -m twin.effects._table > docs/effects.md``."""

from __future__ import annotations

import sys
from math import inf

from twin import effects
from twin.effects import Effect, LookAlike
from twin.effects._parameters import Parameter

OPENING = """# Effects

What reality may add to a twin. Each stands in one file of `twin/effects/`; this page is made from their declarations
(`python -m twin.effects._table > docs/effects.md`).

In a twin, any number of them:

```toml
[[effect]]
name = "time_delay"
delay = 0.005

[[effect]]
name = "gyro_temperature"
slope = [0.0, 0.0, 0.5]     # per axis; one number for all, or { z = 0.5 }
```

At least one of the parameters that carry the severity (those with a value of no effect) is stated. All effects act on
the sub-IMU unless the name says otherwise; angles are rotation vectors in m-axes. Effects that bend the deck show in
the truth channels, and bending moves the lever arm; errors of sensors do not. Each effect draws from a generator of its
own: adding one leaves the noise, the flexure and all other effects as they were.

The prior range is that of the size (either sign where ± stands). A share in brackets says how much of the whitened
trace of one effect the other explains, as measured; channels that end the likeness are named.

**To add one**: a file in `twin/effects/` with one class (`name`, fields by `parameter`, `needs`, `look_alikes`,
`advice`, and the hooks it acts through, see `twin/effects/__init__.py`), and a line in its `REGISTRY`.
"""


def document() -> str:
    """The whole page."""
    sections = [_section(effects.get(name)) for name in effects.names()]
    return OPENING + "\n" + _index() + "\n" + "\n".join(sections)


def _index() -> str:
    rows = [f"| [`{name}`](#{name}) | {_units(effects.get(name))} | {_where(effects.get(name))} |"
            for name in effects.names()]  # fmt: skip
    return "\n".join(["| effect | parameters | channels needed |", "|---|---|---|", *rows, ""])


def _units(effect: type[Effect]) -> str:
    return ", ".join(f"`{item.name}`" + (f" ({item.unit})" if item.unit else "") for item in effect.parameters())


def _where(effect: type[Effect]) -> str:
    return ", ".join(f"`{channel}`" for channel in effect.needs)


def _section(effect: type[Effect]) -> str:
    lines = [f"## {effect.name}", "", effect.about(), ""]
    lines += ["| parameter | unit | what | prior range | default | no effect |", "|---|---|---|---|---|---|"]
    lines += [_row(item) for item in effect.parameters()]
    lines += [f"| `{axis}` | | x, y or z | | x | |" for axis in effect.model_fields if axis == "axis"]
    lines += ["", f"Needs {_where(effect)}. Shows in the truth: {'yes' if effect.bends else 'no'}.", ""]
    alikes = effects.look_alikes(effect.name, ())
    if alikes:
        lines += ["Looks like:", "", *(_alike(alike) for alike in alikes), ""]
    return "\n".join([*lines, f"Advice: {effect.advice}", ""])


def _row(item: Parameter) -> str:
    low, high = item.prior
    span = f"{'±' if item.signed else ''}{low:g} … {high:g}"
    default = "stated" if item.default is None else "the twin's" if item.default == (None,) * 3 else f"{item.default:g}"
    neutral = {None: "", "twin": "the twin's", inf: "infinite"}.get(item.neutral)
    what = item.about + (", x y z" if item.per_axis else "")
    none = f"{item.neutral:g}" if neutral is None else neutral
    return f"| `{item.name}` | {item.unit} | {what} | {span} | {default} | {none} |"


def _alike(alike: LookAlike) -> str:
    share = f" ({alike.share:g})" if alike.share is not None else ""
    until = f" [{', '.join(alike.until)}]" if alike.until else ""
    return f"- `{alike.name}`{share}. Told apart by {alike.separated_by}{until}."


if __name__ == "__main__":
    sys.stdout.write(document())
