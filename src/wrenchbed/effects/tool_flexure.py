"""Effect ``tool.flexure``: the tool bends under its own weight."""

import numpy as np

from wrenchbed.effects.base import LoadEffect, MjSpec, Pose, Sizes, Values, Variant, alike
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.rotations import cross
from wrenchbed.robots.base import Robot

NAMES = tuple(f"compliance.{a}" for a in "xyz")
SKEW = tuple(f"compliance.{a}" for a in ("xy", "xz", "yz"))


class ToolFlexure(LoadEffect):
    """c → c + C F + φ × c, so T += (C F + φ × c) × F with C symmetric (3, 3), φ = b (c × F).

    c: the tool's CoG; F: force on it; b: ``bending``. A tool that is equally soft along x, y and z
    shows nothing.

    Seen in: varied orientations with a second payload: the torque is quadratic in the load.
    """

    name = "tool.flexure"
    title = "the tool bends under its own weight"
    size_error = 0.1
    source = "1e-6–1e-5 m/N in metal, 1e-4 in plastic: estimate"
    numbers = (
        *alike((*NAMES, *SKEW), "m/N", 2e-5, 0.1, "CoG along the load"),
        *alike(("bending",), "rad/(N·m)", 2e-3, 10.0, "tilt under the own moment"),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        single = [Variant(f"along {n[-1]}", (n,), detail={"axis": n[-1]}) for n in NAMES]
        return (
            *single,
            Variant("along x and y", NAMES[:2], weight=2.0),  # with z it would be alike: nothing
            Variant("bends", ("bending",), weight=2.0),
            Variant("along any way", (*NAMES[:2], *SKEW), weight=2.0),
        )

    def size(self, scene: Scene, variant: Variant, p: Values) -> Sizes:
        shift = _shift(scene, scene.tool_force(scene.load), p)
        return {"sag": (float(np.linalg.norm(shift, axis=1).max()), "m")}

    def pull(self, scene: Scene, pose: Pose, load: np.ndarray, p: Values) -> np.ndarray:
        force = scene.tool_force(load)
        return np.concatenate([np.zeros_like(force), cross(_shift(scene, force, p), force)], axis=1)

    def edit_spec(self, spec: MjSpec, robot: Robot, theta: np.ndarray, p: Values) -> None:
        """Hang the tool's mass on sprung hinges at the sensor and on sprung slides."""
        from wrenchbed.simulation.springs import Spring, hinge, slide, tool_mass

        if p["bending"]:
            mass = tool_mass(spec, self.name)
            for axis, way in zip("xyz", np.eye(3), strict=True):
                about = [*map(float, way)]
                hinge(self.name, f"bends.{axis}", mass, about, Spring(1.0 / p["bending"]))
        give, ways = np.linalg.eigh(compliance(p))
        for k, (soft, way) in enumerate(zip(give, ways.T, strict=True)):
            if soft:
                slide(spec, self.name, str(k + 1), [*map(float, way)], Spring(1.0 / float(soft)))


def _shift(scene: Scene, force: np.ndarray, p: Values) -> np.ndarray:
    """CoG's displacement (M, 3) [m] by forces (M, 3) [N] on a soft tool; p: effect's values."""
    cog = np.broadcast_to(scene.tool.cog, force.shape)
    return np.asarray(force @ compliance(p) + cross(p["bending"] * cross(cog, force), cog))


def compliance(p: Values) -> np.ndarray:
    """Symmetric compliance matrix C (3, 3) [m/N] from its six parameters in p."""
    x, y, z, xy, xz, yz = (p[n] for n in (*NAMES, *SKEW))
    return np.array([[x, xy, xz], [xy, y, yz], [xz, yz, z]])


EFFECT = ToolFlexure()
