"""The ground: a grid with its scale in metres."""

from __future__ import annotations

import viser

CELL_M, SECTION_M = 1.0, 10.0
GRID_TEXT = f"grid {CELL_M:.0f} m, bold {SECTION_M:.0f} m"
_LABELS_M = (-40, -20, 20, 40)


class Ground:
    """The grid, with its scale in metres."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        scene.add_grid(
            f"{root}/grid",
            infinite_grid=True,
            cell_size=CELL_M,
            section_size=SECTION_M,
            cell_color=(50, 57, 66),
            section_color=(82, 92, 105),
            section_thickness=1.4,
            fade_distance=130.0,
            fade_strength=1.4,
            shadow_opacity=0.0,
        )
        self._labels = {
            (along, at): scene.add_label(
                f"{root}/scale/{along}{at}",
                "",
                position=(at, 0.0, 0.02) if along == "x" else (0.0, at, 0.02),
                visible=False,
                font_size_mode="scene",
                font_scene_height=0.6,
                anchor="center-center",
            )
            for along in "xy"
            for at in _LABELS_M
        }

    def label(self, origin: tuple[float, float]) -> None:
        """Label the grid in map coordinates; `origin` is the local origin in the map, m."""
        for (along, at), handle in self._labels.items():
            handle.text = f"{along} = {origin['xy'.index(along)] + at:.0f} m"
            handle.visible = True
