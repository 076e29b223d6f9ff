"""All residuals of a session in one list, the largest first, and their statistics by role."""

import math

import numpy as np

from .rows import ROLES, TIE, ResidualRow
from .session import PointSession


def list_residuals(session: PointSession) -> list[ResidualRow]:
    """Return the measurements that have a residual, sorted by its length in standard deviations, the largest first."""
    rows = []
    for key, measured in session.measured.items():
        left, length, why = session.judge(key)
        if not math.isnan(left[0]):
            rows.append(ResidualRow(session.points[key[0]], key[1], measured.kind, left, length, why))
    return sorted(rows, key=lambda row: -math.inf if math.isnan(row.statistic) else row.statistic, reverse=True)


def summarise_roles(session: PointSession) -> list[str]:
    """Return one line for each role: numbers of points and measurements, and the RMSE of their residuals."""
    lines, of_points, of_images = [], session.rows(), list_residuals(session)
    for role in (*ROLES[:2], TIE):
        rows = [row for row in of_images if row.point.role == role]
        if not rows:
            continue
        across, down = np.sqrt(np.mean(np.square([row.residual_px for row in rows]), axis=0))
        points = len({row.point.id for row in rows})
        text = f"{role}: {points} points, {len(rows)} rays, RMSE {across:.2f}, {down:.2f} px"
        left = [row.residual_m for row in of_points if row.point.role == role and not math.isnan(row.residual_m[0])]
        if left:
            text += ", E {:.2f}, N {:.2f}, H {:.2f} m".format(*np.sqrt(np.mean(np.square(left), axis=0)))
        lines.append(text)
    return lines
