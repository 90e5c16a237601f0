"""JSON as commands print it and files hold it."""

import json
from collections.abc import Mapping, Sequence


def dumps(document: Mapping[str, object] | Sequence[object] | None) -> str:
    """JSON text; NaN and infinity are errors, since other programs cannot read them.

    Raises ValueError if a number is not finite.
    """
    # DEL is the one control character that JSON leaves as it is
    return json.dumps(document, indent=2, allow_nan=False).replace("\x7f", r"\u007f")
