"""Parameters of a study: a dataclass whose fields know their unit, rule and help, and so make the command line."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any, get_args, get_type_hints

import click

POSITIVE, NOT_NEGATIVE, SHARE = "positive", "zero or positive", "above 0 and at most 1"
_RULES: dict[str, Callable[[float], bool]] = {
    POSITIVE: lambda value: value > 0,
    NOT_NEGATIVE: lambda value: value >= 0,
    SHARE: lambda value: 0 < value <= 1,
}


_KINDS = {str: "WORD", int: "NUMBER", float: "NUMBER"}


def parameter(
    default: Any, text: str, unit: str = "", rule: str = "", choices: tuple[str, ...] = (), shown: str = ""
) -> Any:
    """A dataclass field that is an option: default, help, unit, rule for numbers or allowed words.

    Args:
        shown: default as the help shows it, where None stands for something found later.
    """
    metadata = {"text": text, "unit": unit, "rule": rule, "choices": choices, "shown": shown}
    return dataclasses.field(default=default, metadata=metadata)


def check(parameters: Any) -> None:
    """Check all fields against their rules.

    Raises:
        ValueError: names field, value, rule and unit.
    """
    for field in dataclasses.fields(parameters):
        value, about = getattr(parameters, field.name), field.metadata
        if value is None:
            continue
        if about.get("choices") and value not in about["choices"]:
            raise ValueError(f"{field.name}={value} must be one of {', '.join(about['choices'])}")
        rule = about.get("rule")
        if rule and not (math.isfinite(value) and _RULES[rule](value)):
            unit = f" ({about['unit']})" if about["unit"] else ""
            raise ValueError(f"{field.name}={value} must be {rule}{unit}")


def shown_default(field: dataclasses.Field) -> str:
    """A field's default as the help shows it, with its unit."""
    if field.metadata["shown"]:
        return field.metadata["shown"]
    if isinstance(field.default, (bool, str)):
        return str(field.default)
    return f"{field.default:g} {field.metadata['unit'].replace('-', '')}".strip()


def click_options(kind: type, without: tuple[str, ...] = ()) -> Callable[[Any], Any]:
    """Decorator that gives a click command one option a field, with unit and default in the help."""
    hints = get_type_hints(kind)

    def decorate(command: Any) -> Any:
        for field in reversed([one for one in dataclasses.fields(kind) if one.name not in without]):
            about, hint = field.metadata, hints[field.name]
            types = [part for part in get_args(hint) if part is not type(None)] or [hint]
            flag = types[0] is bool
            words = f" [{'|'.join(about['choices'])}]" if about["choices"] else ""
            command = click.option(
                "--" + field.name.replace("_", "-"), field.name, default=field.default, is_flag=flag,
                type=None if flag else types[0], metavar=None if flag else about["unit"].replace("-", "") or _KINDS[types[0]],
                help=f"{about['text']}{words}  [default: {shown_default(field)}]",
            )(command)  # fmt: skip
        return command

    return decorate


def size_in_metres(name: str, text: str) -> tuple[float, float]:
    """Width and depth (m) of a text such as "6x3".

    Raises:
        ValueError: the text is not two positive numbers with an x between.
    """
    try:
        width, depth = (float(part) for part in text.split("x"))
    except ValueError:
        raise ValueError(f"{name}={text} must be WIDTHxDEPTH in metres, for instance 6x3") from None
    if not (math.isfinite(width) and math.isfinite(depth) and width > 0 and depth > 0):
        raise ValueError(f"{name}={text} must have positive width and depth (m)")
    return width, depth
