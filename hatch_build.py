"""Build hook: compiles the C parts when the package is installed or its wheel is built.

They are the simulated car, and the control law that `--mpc.plan native` drives with.

The wheel and the source distribution also get the git revision, which `--version` shows.

Where no C compiler is installed, the build fetches one as a package. Where that fails too, the
package is built without them: the controller needs neither.
"""

import runpy
import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_WITH_ZIG = "platform_machine in 'x86_64 amd64 aarch64 arm64'"
"""machines for which the compiler exists as a package"""


class CompiledParts(BuildHookInterface[Any]):
    """Puts the libraries into the wheel, or into the checkout that is installed as editable."""

    def dependencies(self) -> list[str]:
        """Packages that the build needs beside its own."""
        if self.target_name == "sdist":
            return []
        sys.path.insert(0, self.root)  # the package is not installed yet
        from rt_controller.contract.compiler import CompileError, find_compiler

        try:
            find_compiler()
        except CompileError:
            return [f"ziglang>=0.13; {_WITH_ZIG}"]
        return []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile; the wheel is one of this platform, for every version of Python."""
        sys.path.insert(0, self.root)
        from rt_controller.contract.compiler import CompileError
        from rt_controller.native.compiler import BUILT as LAW
        from rt_controller.native.compiler import compile_law
        from sim_bridge.plant.compiler import BUILT as CAR
        from sim_bridge.plant.compiler import compile_car

        if version != "editable":
            self._include_revision(CAR, build_data)
        if self.target_name == "sdist":
            return
        try:
            libraries = [compile_car(CAR), compile_law(LAW)]
        except (CompileError, OSError) as error:
            self.app.display_warning(f"Car and control law are not compiled: {error}.")
            return
        if version != "editable":
            platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
            build_data["tag"] = f"py3-none-{platform}"
            build_data["pure_python"] = False
            for library in libraries:
                inside = str(library.relative_to(self.root))
                build_data["force_include"][str(library)] = inside

    def _include_revision(self, folder: Path, build_data: dict[str, Any]) -> None:
        """Put the revision into the package; `folder` is not under version control.

        A source distribution has the file already.
        """
        contract = Path("rt_controller", "contract")
        module = runpy.run_path(str(Path(self.root) / contract / "revision.py"))
        file = folder / module["REVISION_FILE"]
        if (Path(self.root) / contract / file.name).exists():
            return
        folder.mkdir(exist_ok=True)
        file.write_text(module["source_revision"](), "ascii")
        build_data["force_include"][str(file)] = str(contract / file.name)
