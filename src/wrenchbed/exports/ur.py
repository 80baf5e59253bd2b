"""URScript: payload and gravity of Universal Robots' controllers."""

from collections.abc import Sequence

from wrenchbed.exports.base import Export, ExportOptions
from wrenchbed.exports.load_numbers import LoadNumbers
from wrenchbed.files.checked import listed


class UniversalRobots(Export):
    """Export format for Universal Robots: a URScript program, whose lines may be copied."""

    name = "ur"
    title = "URScript with set_target_payload and set_gravity"
    source = "Universal Robots, The URScript Programming Language, modules motion and internals"
    needs_flange = True
    carries = ("mass", "cog", "inertia", "gravity")

    def text(self, numbers: LoadNumbers, options: ExportOptions, notes: Sequence[str]) -> str:
        mass = float(numbers.mass.needed(self.name)[0])
        load = f"{mass!r}, {listed(numbers.cog.needed(self.name))}"
        if numbers.inertia.known:
            load += f", {listed(numbers.inertia.value)}"
        # URScript wants the acceleration that holds the robot against its weight
        gravity = listed(0.0 - numbers.gravity.needed(self.name))
        return self.commented(notes) + (
            f"def wrenchbed_payload():\n  set_gravity({gravity})\n"
            f"  set_target_payload({load})\nend\n"
        )

    def hints(self, numbers: LoadNumbers) -> tuple[str, ...]:
        return (
            "inertia as Ixx Iyy Izz Ixy Ixz Iyz; without it the controller keeps its own estimate",
            "controllers before PolyScope 5.10 have set_payload(mass, CoG) instead",
        )


EXPORT = UniversalRobots()
