"""Which block the panel shows, kept in the QGIS project."""

from dataclasses import dataclass

from qgis.core import QgsProject

_SCOPE = "hrsi"


@dataclass(frozen=True)
class PanelState:
    """The block's GeoPackage (as the project keeps paths: relative or not), model, kind of target and chosen point."""

    path: str = ""
    model: str = "auto"
    kind: str = "center"
    point: str = ""


def store(state: PanelState, project: QgsProject) -> None:
    """Write the state into a project; the user saves it with the project."""
    project.writeEntry(_SCOPE, "/points/path", project.writePath(state.path) if state.path else "")
    for name in ("model", "kind", "point"):
        project.writeEntry(_SCOPE, f"/points/{name}", getattr(state, name))


def restore_state(project: QgsProject) -> PanelState:
    """Return the state that a project keeps."""
    default = PanelState()
    path = project.readEntry(_SCOPE, "/points/path", "")[0]
    others = {
        name: project.readEntry(_SCOPE, f"/points/{name}", getattr(default, name))[0]
        for name in ("model", "kind", "point")
    }
    return PanelState(project.readPath(path) if path else "", **others)
