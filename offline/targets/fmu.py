"""`write_fmu`: the controller in C as an FMU for co-simulation, FMI 2.0."""

import platform
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from uuid import NAMESPACE_URL, uuid5
from xml.sax.saxutils import escape

from offline.targets.c_source import filled
from rt_controller.config import MpcSettings
from rt_controller.contract.compiler import CompileError, compile_library
from rt_controller.contract.errors import ConfigError, MissingExtraError
from rt_controller.contract.figures import require_writable
from rt_controller.contract.files import atomic_write
from rt_controller.model.bundle import Bundle
from rt_controller.native.compiler import SOURCES
from rt_controller.native.constants import constants_of
from rt_controller.native.source import model_source

_GLUE = Path(__file__).with_name("fmi2.c")
_DESCRIPTION = Path(__file__).with_name("modelDescription.xml")
"""with @NAME@, @SHA256@ and @GUID@, which the library compares at instantiation, and @FILES@"""
_OPTIONS = ("-fvisibility=hidden",)
"""several FMUs in one process do not see each other's functions"""
_TIME_STAMP = (2020, 1, 1, 0, 0, 0)
"""of all files inside: the same model and compiler give the same bytes"""


def write_fmu(file: Path, bundle: Bundle, settings: MpcSettings) -> None:
    """Write the FMU of a model and the settings of its control law.

    Raises:
        MissingExtraError: this machine cannot compile it.
        ArtifactError, ConfigError: as `constants_of`.
        ConfigError: the name does not end in .fmu, or the file cannot be written.
    """
    require_writable(file, "--output", suffix=".fmu")
    sources = {path.name: path.read_text("utf-8") for path in [*SOURCES.glob("*.[ch]"), _GLUE]}
    sources["mdk_model.c"] = model_source(constants_of(bundle, settings), "MDK_MODEL")
    guid = f"{{{uuid5(NAMESPACE_URL, repr(sorted(sources.items())))}}}"
    sources["mdk_model.c"] += f'\nconst char FMU_GUID[] = "{guid}";\n'
    machine = platform.machine()
    folder = "linux64" if machine == "x86_64" else f"{machine}-linux"
    values = {
        "NAME": escape(bundle.name, {'"': "&quot;"}),
        "SHA256": bundle.sha256,
        "GUID": guid,
        "FILES": "".join(f'<File name="{name}"/>' for name in sorted(sources) if name[-2:] == ".c"),
    }
    content = {
        "modelDescription.xml": filled(_DESCRIPTION.read_text("utf-8"), values).encode(),
        f"binaries/{folder}/mdk_controller.so": _compiled(sources),
        **{f"sources/{name}": text.encode() for name, text in sources.items()},
    }
    try:
        with atomic_write(file) as out, zipfile.ZipFile(out, "w") as archive:
            for name in sorted(content):
                entry = zipfile.ZipInfo(name, _TIME_STAMP)
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.external_attr = 0o644 << 16
                archive.writestr(entry, content[name])
    except OSError as error:
        raise ConfigError(
            f"--output: expected a file that can be written, found {file}: {error.strerror}. "
            f"Choose another one."
        ) from error


def _compiled(sources: Mapping[str, str]) -> bytes:
    with tempfile.TemporaryDirectory(prefix="fmu-") as place:
        folder, library = Path(place), Path(place) / "library.so"
        for name, text in sources.items():
            (folder / name).write_text(text, encoding="utf-8")
        try:
            compile_library(sorted(folder.glob("*.c")), library, folder, _OPTIONS)
        except CompileError as error:
            raise MissingExtraError(f"The FMU is not compiled: {error}.") from error
        return library.read_bytes()
