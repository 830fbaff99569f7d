"""Methods and their options as words of the command line; what is not there is wrong usage, status 2."""

from __future__ import annotations

from collections.abc import Sequence

import typer

from pipeline.registries import check_name
from pipeline.settings import Settings, parsed


def named(stage: str, option: str, name: str | None) -> None:
    """Stop with exit status 2 and the list of names if there is no method of that name."""
    try:
        check_name(stage, name)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint=option) from error


def chosen_settings(
    words: Sequence[str] | None, estimators: Sequence[str], identifier: str | None, shapes: Sequence[str] = ()
) -> Settings:
    """What --set says; stop with exit status 2 and the options there are if it fits no method that runs."""
    try:
        settings = parsed(words or ())
        if settings.given:
            from pipeline.one_log import own_identifier

            identifiers = [identifier] if identifier else [own_identifier(name) for name in estimators]
            stages = (("estimate", estimators), ("identify", identifiers), ("shape", shapes))
            settings.check([(stage, name) for stage, of_stage in stages for name in dict.fromkeys(of_stage)])
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--set") from error
    return settings
