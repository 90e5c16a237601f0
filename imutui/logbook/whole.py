"""A text file that is there whole or not at all."""

from pathlib import Path


def write(path: Path, text: str, *, overwrite: bool) -> None:
    """Write a text so that the file is there whole or not at all.

    Raises
    ------
    FileExistsError
        If it exists and may not be replaced.
    """
    if not overwrite:
        # an empty file of our own marks the name as taken
        path.open("x").close()
    part = path.with_name(path.name + ".part")
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        if not overwrite:
            path.unlink(missing_ok=True)
        raise
