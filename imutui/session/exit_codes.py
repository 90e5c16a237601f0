"""Exit codes of the acquisition process, which the command that follows it ends with: see docs/commands.md."""

FINDINGS = 1
OWN_ERROR = 1
USAGE = 2
INSTRUMENT = 4
DISK = 5
