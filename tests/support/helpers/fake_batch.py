"""A batch of acquisitions that are not there."""

import contextlib
import time
from collections.abc import AsyncIterator, Callable
from typing import Any, cast

import pytest

from helpers.fake_client import FakeClient, bias, estimates
from helpers.pilot import SMALLEST, See
from imutui.session import client as session
from imutui.session.client import Client
from imutui.session.plan import RecordingWish
from imutui.tui.app import ImutuiApp
from imutui.tui.connection.rack import Rack

BAD_AXIS = "segment 3: az reads 5.0 mg more than the model: scale factor of +0.50 %? It speaks against the unit"


def settled(**changes: Any) -> Any:
    """A filter with nothing left to be said."""
    names = ("x gyro", "y gyro", "z gyro", "x accel", "y accel", "z accel")
    quiet = [{"channel": c, "ratio": 1.0, "windows": 6} for c in ("gx", "gy", "gz", "ax", "ay", "az")]
    found = {"biases": [bias(name, 0.01, 0.02) for name in names], "remainder": quiet}
    return estimates(**(found | {"temperature_k_per_min": 0.01} | changes))


class Unit(FakeClient):
    """A unit of a batch, at a step of a profile of six positions."""

    def __init__(self, number: int, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(f"lot:{number}", clock=clock)
        self.changes |= {"serial_number": f"990000{number}", "filter": settled(), "note": "lot 7"}

    def at(self, state: str, segment: int = 0, left_s: float | None = None) -> None:
        """Be there in the profile."""
        segments = [
            {"kind": "dwell", "text": f"go to outer {angle}°, middle 0°, inner 0°", "seconds": 30.0}
            for angle in range(0, 360, 60)
        ]
        self.table_profile = cast("Any", {"name": "six.toml", "align": "marks", "segments": segments})
        guide = {"state": state, "segment": segment, "count": 6, "left_s": left_s, "begun": [None] * 6}
        self.recording = bool(state)
        self.changes |= {
            "reference": {"name": "profile", "file": "six.toml", "profile": True},
            "guide": guide if state else None,
        }

    def guide(self, do: str, wish: RecordingWish | None = None) -> None:
        """Go on as an acquisition does."""
        super().guide(do, wish)
        now = self.changes["guide"] or {"segment": 0}
        state, left = {"begin": ("go", None), "next": ("hold", 30.0), "cancel": ("cancelled", None)}[do]
        self.at(state, now["segment"], left)


class Batch:
    """Four acquisitions that are not there; the third has a bad axis."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, clock: Callable[[], float] = time.monotonic) -> None:
        self.units = {f"lot:{n}": Unit(n, clock) for n in range(1, 5)}
        self.units["lot:3"].changes["filter"] = settled(departure=BAD_AXIS)
        monkeypatch.setattr(session, "attach", self.attach)

    def attach(self, name: str) -> Client:
        """The acquisition of that name, if it runs."""
        found = self.units[name]
        found.snapshot(0)
        return cast("Client", found)

    def rack(self) -> Rack:
        return Rack("lot", lambda _: dict.fromkeys(self.units), self.attach)

    @contextlib.asynccontextmanager
    async def opened(self, size: tuple[int, int] = SMALLEST) -> AsyncIterator[See]:
        """The application on them, once all have answered."""
        rack = self.rack()
        async with ImutuiApp(rack=rack).run_test(size=size) as pilot:
            see = See(pilot, FakeClient())
            serials = " | ".join(unit.changes["serial_number"] for unit in self.units.values())
            await see(f"→ batch lot  {len(self.units)} units | {serials} | !WAIT")
            yield see
        rack.close()

    def asked(self) -> list[list[str]]:
        return [unit.asked for unit in self.units.values()]
