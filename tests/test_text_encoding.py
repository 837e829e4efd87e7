"""Text is UTF-8 whatever the locale: no file and no program's output is read or written without saying so."""

import ast
from pathlib import Path

import coronaryuq


def _of_the_locale(call: ast.Call) -> bool:
    name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    given = {keyword.arg for keyword in call.keywords}
    if name in ("read_text", "write_text") and isinstance(call.func, ast.Attribute):
        return "encoding" not in given
    if name == "open" and isinstance(call.func, ast.Name):
        binary = len(call.args) > 1 and "b" in ast.unparse(call.args[1])
        return not binary and "encoding" not in given
    return name in ("run", "Popen") and "text" in given


def test_no_text_depends_on_the_locale():
    root = Path(coronaryuq.__file__).parent
    found = [
        f"{path.relative_to(root)}:{node.lineno}"
        for path in sorted(root.rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and _of_the_locale(node)
    ]
    assert not found, found
