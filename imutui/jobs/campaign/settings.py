"""What a campaign is asked for, the same for all of its logs; and what is decided by it, as a hash."""

import hashlib
import json
from dataclasses import dataclass, field

from imutui.jobs.campaign.rows import SettingsFields
from imutui.jobs.replay import ReplayOptions


@dataclass(frozen=True, slots=True)
class CampaignSettings:
    """How each log is to be taken; it can be pickled, so that it reaches workers."""

    # of the replay: overrides, reference and effects; nothing else of them counts
    options: ReplayOptions = field(default_factory=ReplayOptions)
    trace: bool = False  # whether each log is traced too, on its own

    def fields(self) -> SettingsFields:
        """As documents have it: files by their hashes."""
        reference, effects = self.options.reference, self.options.effects
        return {
            "overrides": dict(sorted((self.options.overrides or {}).items())),
            "reference_sha256": None if reference is None else _sha256(reference.content),
            "effects_sha256": None if effects is None else _sha256(effects),
            "trace": self.trace,
        }

    def sha256(self) -> str:
        """Hash of `fields`: rows with another one are computed anew."""
        return _sha256(json.dumps(self.fields(), sort_keys=True).encode())


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
