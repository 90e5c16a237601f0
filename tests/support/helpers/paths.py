"""Where things lie that tests read."""

from pathlib import Path

ROOT = Path(__file__).parents[3]
SAMPLE = ROOT / "logs" / "sample.mcap"
DATA = ROOT.parent / "shared" / "data"  # measured recordings, which not every machine has
