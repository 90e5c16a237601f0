"""Jobs over logs, as plain functions from files to result records: no printing, no exit codes."""
