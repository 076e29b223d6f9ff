"""The panel's actions: their keys, errors of input, which they show instead of raising them, and pauses before them."""

from collections.abc import Callable, Iterable
from functools import wraps
from typing import Any

from qgis.PyQt.QtCore import QCoreApplication, QEvent, QObject, QTimer
from qgis.PyQt.QtGui import QKeyEvent, QKeySequence
from qgis.PyQt.QtWidgets import QAction

from ...hrsi_engine.foundation.errors import HrsiError, MissingPackageError
from ..dependencies import missing_package_message
from ..package_offer import offer_packages


def show_errors(method: Callable[..., Any]) -> Callable[..., Any]:
    """Return a method that shows errors of input by the ``tell`` of its object instead of raising them."""

    @wraps(method)
    def run(self: Any, *arguments: Any, **options: Any) -> Any:
        try:
            return method(self, *arguments, **options)
        except (MissingPackageError, ImportError) as error:
            message = missing_package_message(error)
            if message is None:
                raise
            self.tell(message, is_error=True)
            offer_packages()
        except HrsiError as error:
            self.tell(str(error), is_error=True)
        return None

    return run


def make_pause(parent: QObject, pause_ms: int, slot: Callable[[], Any]) -> QTimer:
    """Return a timer that calls a slot once, this long after it was last started."""
    timer = QTimer(parent)
    timer.setSingleShot(True)
    timer.setInterval(pause_ms)
    timer.timeout.connect(slot)
    return timer


class ShortcutMap(QObject):
    """Triggers actions by their keys, before QGIS's own ones, while any part of their widget has the focus."""

    def __init__(self, parent: QObject, actions: Iterable[QAction]) -> None:
        super().__init__(parent)
        self._actions = [action for action in actions if not action.shortcut().isEmpty()]
        self._pressed: QAction | None = None  # action whose key was claimed

    def claim(self, event: QEvent) -> bool:
        """Claim the keys of an enabled action before QGIS does; keys typed into a cell are not offered here."""
        if event.type() != QEvent.Type.ShortcutOverride or (action := self.find_action(event)) is None:
            return False
        event.accept()  # so that the widget with the focus gets a key press instead
        self._pressed = action
        QCoreApplication.instance().installEventFilter(self)
        return True

    def find_action(self, event: QKeyEvent) -> QAction | None:
        """Return the enabled action whose keys are pressed, None if there is none."""
        is_qt6 = hasattr(event, "keyCombination")
        keys = QKeySequence(event.keyCombination() if is_qt6 else int(event.modifiers()) | event.key())
        return next((one for one in self._actions if one.isEnabled() and one.shortcut() == keys), None)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Trigger the action for the next key press, which `claim` has claimed."""
        if self._pressed is None or event.type() != QEvent.Type.KeyPress:
            return False
        QCoreApplication.instance().removeEventFilter(self)
        action, self._pressed = self._pressed, None
        action.trigger()
        return True
