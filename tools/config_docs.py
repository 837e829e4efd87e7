"""Write config/README.md, config/schema.json and the fields of docs/reference/case.md from their models."""

from pathlib import Path

from coronaryuq import config
from coronaryuq.case.description.reference import reference
from coronaryuq.case.tables.targets import names_reference
from coronaryuq.core.io.atomic import write_json, write_text

if __name__ == "__main__":
    root = Path(__file__).parents[1]
    write_text(root / "config" / "README.md", config.readme())
    write_json(root / "config" / "schema.json", config.schema())
    case = root / "docs" / "reference" / "case.md"
    write_text(
        case, case.read_text(encoding="utf-8").partition("### `case.yaml`")[0] + f"{reference()}\n{names_reference()}"
    )
