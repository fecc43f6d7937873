"""Build hook: compiles the simulated car when the package is installed or its wheel is built.

The wheel and the source distribution also get the git revision, which `--version` shows.

Where no C compiler is installed, the build fetches one as a package. Where that fails too, the
package is built without the car: the controller needs no compiler.
"""

import runpy
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_WITH_ZIG = "platform_machine in 'x86_64 amd64 aarch64 arm64'"
"""machines for which the compiler exists as a package"""


class CompiledCar(BuildHookInterface[Any]):
    """Puts the compiled car into the wheel, or into the checkout that is installed as editable."""

    def dependencies(self) -> list[str]:
        """Packages that the build needs beside its own."""
        if self.target_name == "sdist":
            return []
        compiler = self._compiler()
        try:
            compiler["find_compiler"]()
        except compiler["CompileError"]:
            return [f"ziglang>=0.13; {_WITH_ZIG}"]
        return []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile; the wheel is one of this platform, for every version of Python."""
        compiler = self._compiler()
        if version != "editable":
            self._include_revision(compiler["BUILT"], build_data)
        if self.target_name == "sdist":
            return
        try:
            library: Path = compiler["compile_car"](compiler["BUILT"])
        except (compiler["CompileError"], OSError) as error:
            self.app.display_warning(f"The simulated car is not compiled: {error}.")
            return
        if version != "editable":
            platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
            build_data["tag"] = f"py3-none-{platform}"
            build_data["pure_python"] = False
            build_data["force_include"][str(library)] = str(library.relative_to(self.root))

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

    def _compiler(self) -> dict[str, Any]:
        """The names of the module, which cannot be imported before the package is installed."""
        return runpy.run_path(str(Path(self.root) / "sim_bridge" / "plant" / "compiler.py"))
