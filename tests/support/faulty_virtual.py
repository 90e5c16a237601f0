"""`imutui virtual` with faults of all kinds of `helpers.faulty_lines`, which a scenario does not have.

    python faulty_virtual.py FAULTS.json [arguments of imutui virtual]

FAULTS.json is a list of objects with the fields of `LineFault`.
"""

import json
import sys
from pathlib import Path
from typing import Any

from helpers.faulty_lines import FaultyLine, FaultyWire, LineFault, serve_faulty

from imutui import cli
from imutui.instrument import virtual


def main() -> None:
    faults = [LineFault(**fault) for fault in json.loads(Path(sys.argv.pop(1)).read_text())]

    def wire(unit: Any, line: Any, *how: Any) -> FaultyWire:
        return FaultyWire(unit, FaultyLine(faults, seed=len(faults)), *how)

    virtual.Wire = wire  # type: ignore[assignment,misc]
    virtual.serve = serve_faulty  # type: ignore[assignment]
    sys.argv.insert(1, "virtual")
    cli.main()


if __name__ == "__main__":
    main()
