"""Questions before something ends, or is changed for good."""

from collections.abc import Sequence
from pathlib import PurePath

from imutui.session.snapshot import Snapshot
from imutui.tui import messages
from imutui.tui.pages.connect import text
from imutui.tui.pages.dialogs.choice import Answer, ChoiceDialog


def _recording(snapshot: Snapshot | None) -> str | None:
    recording = snapshot["recording"] if snapshot else None
    return PurePath(recording["path"]).name if recording else None


def quit_dialog(snapshot: Snapshot | None, jobs: Sequence[str] = ()) -> ChoiceDialog:
    """Ask whether the acquisition goes on without a screen; jobs of this screen end with it either way."""
    name = _recording(snapshot)
    if name is None:
        body = "It is not recording."
        leave, stop = "leave it running (come back with: imutui attach)", "stop the acquisition and quit"
    else:
        body = f"It is recording {name}."
        leave = "leave it: recording continues in the background"
        stop = "finish the file, stop the acquisition and quit"
    alone = messages.until(snapshot)
    body = "\n".join([body, *([f"Left, it goes on{alone}."] if alone else []), *_ending(jobs)])
    return ChoiceDialog("An acquisition is running", body, [Answer("l", "leave", leave), Answer("s", "stop", stop)])


def jobs_dialog(jobs: Sequence[str]) -> ChoiceDialog:
    """Ask before the jobs of this screen end with it."""
    return ChoiceDialog(
        "Something is still being worked out", "\n".join(_ending(jobs)), [Answer("s", "quit", "stop it and quit")]
    )


def _ending(jobs: Sequence[str]) -> list[str]:
    return [f"{job}: this ends with the screen, without a result." for job in jobs]


def zero_dialog() -> ChoiceDialog:
    """Ask before the instrument is changed; Enter cancels."""
    answers = [Answer("z", "zero", "zero them now: the unit stands still")]
    return ChoiceDialog(text.ZERO_TITLE, text.ZERO_TEXT, answers, careful=True)


def stop_dialog(snapshot: Snapshot | None) -> ChoiceDialog:
    """Ask before an acquisition is stopped to connect to something else."""
    name = _recording(snapshot)
    body = f"Its recording {name} will be finished." if name else "It is not recording."
    return ChoiceDialog("Stop this acquisition?", body, [Answer("s", "stop", "stop it")], careful=True)


def ended_dialog(reason: str, *, typing: bool = False) -> ChoiceDialog:
    """Say that the acquisition is over; letters of somebody who was typing just then are no answers."""
    answers = [Answer("c", "connect", "connect again", also="1"), Answer("q", "quit", "quit")]
    title, stay = "The acquisition has ended", "look at the last data"
    return ChoiceDialog(title, reason, answers, stay=stay, careful=typing, letters=not typing)


def cancel_dialog(job: str) -> ChoiceDialog:
    """Ask before a job is cancelled; Enter lets it go on."""
    answers = [Answer("y", "yes", "cancel it: nothing of it is kept")]
    return ChoiceDialog(f"Cancel {job}?", "It is still being worked out.", answers, careful=True, stay="let it go on")
