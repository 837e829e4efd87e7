"""Write config/README.md and config/schema.json from the configuration model."""

from pathlib import Path

from coronaryuq import config
from coronaryuq.files import write_json, write_text

if __name__ == "__main__":
    folder = Path(__file__).parents[2] / "config"
    write_text(folder / "README.md", config.readme())
    write_json(folder / "schema.json", config.schema())
