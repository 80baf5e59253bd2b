"""Build the compiled static wrench while the package is installed; without a compiler, numpy does.

hatchling calls `KernelHook`; by hand, `python scripts/build_kernel.py`. One library serves Python
3.11 and all later ones (limited API). It is put into its place whole, so builds may run together.
"""

import os
import shlex
import subprocess
import sysconfig
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

SOURCE = Path(__file__).parents[1] / "src" / "wrenchbed" / "robots" / "compiled" / "_statics.c"
FLAGS = ("-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-shared", "-fPIC")
WIDE = ("-mprefer-vector-width=512",)
"""Of x86-64 only."""


def build(folder: Path = SOURCE.parent, more: Sequence[str] = ()) -> Path:
    """Compile into a folder, with more arguments of the compiler.

    Raises:
        OSError, subprocess.CalledProcessError: there is no compiler, or it fails.
    """
    library = folder / "_statics.abi3.so"
    compiler = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc")
    wide = WIDE if "x86_64" in sysconfig.get_platform() else ()
    with tempfile.TemporaryDirectory(dir=folder, prefix=".build-") as place:
        fresh = Path(place) / library.name
        include = f"-I{sysconfig.get_path('include')}"
        inputs = [include, *more, str(SOURCE), "-o", str(fresh), "-lm"]
        command = [*compiler, *FLAGS, *wide, *inputs]
        subprocess.run(command, check=True, capture_output=True, text=True)
        fresh.replace(library)
    return library


class KernelHook(BuildHookInterface):
    """Adds the library, and the tag of its platform, to a wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        try:
            library = build()
        except (OSError, subprocess.CalledProcessError) as error:
            self.app.display_warning(f"the static wrench stays plain numpy: {error}")
            return
        platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["pure_python"] = False
        build_data["tag"] = f"cp311-abi3-{platform}"
        build_data["artifacts"].append(str(library.relative_to(self.root)))


if __name__ == "__main__":
    print(build())
