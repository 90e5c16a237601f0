"""Keys in a terminal that is too small for any page: nobody sees what they would do, so they do nothing."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from textual.dom import DOMNode
from textual.screen import ModalScreen

from imutui.tui.terminal.textual_private import WithoutTraceback
from imutui.tui.widgets import too_small

if TYPE_CHECKING:
    from textual.actions import ActionParseResult

_LEAVING = ("quit", "detach", "suspend_process")


class NothingUnseen(WithoutTraceback):
    """An application whose keys act only where there is room for a page, but for those that leave it."""

    async def run_action(
        self,
        action: "str | ActionParseResult",
        default_namespace: DOMNode | None = None,
        namespaces: Mapping[str, DOMNode] | None = None,
    ) -> bool:
        """Run what a key means; a dialog is seen in any terminal."""
        name = action if isinstance(action, str) else action[1]
        hidden = too_small.is_too_small(self.size) and not isinstance(self.screen, ModalScreen)
        if hidden and name.rpartition(".")[2].partition("(")[0] not in _LEAVING:
            return False
        return await super().run_action(action, default_namespace, namespaces)
