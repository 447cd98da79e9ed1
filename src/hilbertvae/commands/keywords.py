"""Settings of a command as `key=value` words, checked against a dataclass, as those of `hilbertvae-train` are."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import os
import sys
import textwrap
import warnings
from typing import TypeVar

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from hilbertvae import __version__
from hilbertvae.checks import InputError
from hilbertvae.signals import stopped_by_signals
from hilbertvae.terminal import let_go_of_output

T = TypeVar("T")


def settings_of(kind: type[T], words: list[str]) -> T:
    """The dataclass `kind` with the values of `words`, each `key=value`.

    Raises `InputError` for a word without `=`, an unknown key, a key given twice, or a value of another type; it names the key.
    """
    keys, types = [word.partition("=")[0] for word in words], types_of(kind)
    for word, key in zip(words, keys, strict=True):
        if "=" not in word or not key:
            raise InputError(f"{word!r}: expected key=value; see --help")
        if keys.count(key) > 1:
            raise InputError(f"{key}: given more than once")
        if key not in types:
            raise InputError(f"{key}: unknown key; expected one of {', '.join(types)}")
    schema, texts = OmegaConf.structured(kind), {}
    for word, key in zip(words, keys, strict=True):
        text, whole = word.partition("=")[2], types[key]
        typed = whole.removesuffix(" | None")
        if typed == "str":
            unset = text == "null" and whole != typed
            texts[key] = None if unset else text  # as it was typed: a path may hold what YAML and OmegaConf read as their own
            continue
        bare = typed.startswith("list[") and text not in ("", "null") and not text.startswith("[")
        if bare and typed == "list[str]":
            texts[key] = [part.strip() for part in text.split(",") if part.strip()]
            continue
        try:
            value = f"[{text}]" if bare else text  # brackets are what some shells want quoted
            OmegaConf.update(schema, key, OmegaConf.from_dotlist([f"value={value}"])["value"])
        except (OmegaConfBaseException, YAMLError, ValueError) as error:
            wanted = {"list[str]": "[word,word,...]", "list[float]": "[number,number,...]"}.get(typed, typed)
            raise InputError(f"{key}: expected {wanted}, got {text!r}") from error
    settings = OmegaConf.to_object(schema)
    for key, text in texts.items():
        setattr(settings, key, text)
    return settings


def from_home(settings: T, *keys: str) -> T:
    """The settings with `~` or `~name` at the start of these paths, unless they are None, as the user's folder: behind `key=` not every
    shell puts it there, and a folder of that name would be made."""
    paths = {key: getattr(settings, key) for key in keys}
    return dataclasses.replace(settings, **{key: path and os.path.expanduser(path) for key, path in paths.items()})


def types_of(kind: type) -> dict[str, str]:
    """By key, the type as the source writes it."""
    return {part.name: part.type if isinstance(part.type, str) else part.type.__name__ for part in dataclasses.fields(kind)}


def keyword_help(command: str, kind: type, about: str) -> str:
    """What `--help` prints: all keys with their defaults and what the source says of them."""
    said = _documents(kind)
    lines = [f"{command} key=value ...", "", about, ""]
    own = [part for part in dataclasses.fields(kind) if part.name in kind.__annotations__]
    for part in own + [part for part in dataclasses.fields(kind) if part not in own]:  # what is inherited comes last
        default = part.default if part.default is not dataclasses.MISSING else part.default_factory()
        shown = "null" if default is None else default if default != "" else "(needed)"
        shown = ("off", "on")[default] if isinstance(default, bool) else shown
        lines += [f"  {part.name}={shown}", *textwrap.wrap(said.get(part.name, ""), 100, initial_indent=" " * 6, subsequent_indent=" " * 6)]
    return "\n".join(lines)


def _documents(kind: type) -> dict[str, str]:
    """By field, the string below it in the source of its class or of one that it inherits from."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        if not dataclasses.is_dataclass(base):
            continue
        body = ast.parse(textwrap.dedent(inspect.getsource(base))).body[0].body
        for field, below in zip(body, body[1:], strict=False):
            if isinstance(field, ast.AnnAssign) and isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
                found[field.target.id] = " ".join(str(below.value.value).split())
    return found


def run_command(command: str, kind: type[T], about: str, run, words: list[str] | None) -> int:
    """Parse `words` (those of the command line unless given), call `run(settings)`, and give the exit code: 2 for bad input."""
    words = sys.argv[1:] if words is None else words
    try:
        if not words or {"-h", "--help"} & set(words):
            print(keyword_help(command, kind, about), flush=True)
            return 0 if words else 2
        if "--version" in words:
            print(f"hilbertvae {__version__}")
            return 0
        with stopped_by_signals(), warnings.catch_warnings():
            warnings.showwarning = lambda message, *rest, **named: print(f"{command}: {message}", file=sys.stderr)
            run(settings_of(kind, words))
    except KeyboardInterrupt:
        print(f"{command}: stopped", file=sys.stderr)
        return 130
    except BrokenPipeError:  # a reader such as `head` has had enough
        let_go_of_output()
        return 1
    except (InputError, OSError) as error:
        print(f"{command}: {error}", file=sys.stderr)
        return 2
    except (MemoryError, RuntimeError) as error:
        if not isinstance(error, MemoryError) and "memory" not in str(error):  # torch's own kind is for GPUs alone
            raise
        print(f"{command}: out of memory; {str(error).splitlines()[0] if str(error) else 'nothing was written'}", file=sys.stderr)
        return 2
    return 0
