"""The acquisition process: it owns the port and the file, and lives on without any terminal.

`plan` what is asked of it · `info` metadata and names · `connect` the opening dialogue with the instrument ·
`averaging` packets to output samples · `take` one run of recorder and filter · `live` statistics for the screen ·
`engine` the threads · `snapshot` what viewers see · `wire` the socket · `client` how viewers start it and talk to it.
`python -m imutui.session` is the process itself.
"""
