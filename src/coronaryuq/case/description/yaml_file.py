"""Safe reading of small YAML files: no objects, no aliases, no repeated keys, a size limit."""

from pathlib import Path
from typing import Any

import yaml

from coronaryuq.core.errors import InputError

LARGEST = 1_000_000
"""Maximum size, bytes."""


class _Loader(yaml.SafeLoader):
    """Plain YAML values only."""

    def compose_node(self, parent, index):
        if self.check_event(yaml.events.AliasEvent):
            raise yaml.YAMLError(f"line {self.peek_event().start_mark.line + 1}: aliases (*name) are not supported")
        return super().compose_node(parent, index)

    def construct_mapping(self, node, deep=False):
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for key in keys:
            if not isinstance(key, str):
                raise yaml.YAMLError(f"line {node.start_mark.line + 1}: key {key!r} is not text; quote it")
            if keys.count(key) > 1:
                raise yaml.YAMLError(f"line {node.start_mark.line + 1}: {key} is a duplicate")
        return super().construct_mapping(node, deep)


def read_yaml(path: str | Path, wanted: str = "expected a mapping of fields") -> dict[str, Any]:
    """Read a YAML mapping.

    Parameters
    ----------
    path
        The YAML file.
    wanted
        Message of the error if the file does not contain a mapping.

    Raises
    ------
    InputError
        If the file is missing, too large, not valid YAML or not a mapping.
    """
    try:
        size = Path(path).stat().st_size
        if size > LARGEST:
            raise InputError(path, None, f"{size} bytes", f"more than {LARGEST} bytes; expected a short text file")
        content = yaml.load(Path(path).read_text(encoding="utf-8"), Loader=_Loader)
    except FileNotFoundError:
        raise InputError(path, None, None, "no such file") from None
    except OSError as error:
        raise InputError(path, None, None, f"cannot be read ({error.strerror})") from None
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(path, None, None, f"not valid YAML ({error})") from None
    if not isinstance(content, dict):
        raise InputError(path, None, None, wanted)
    return content
