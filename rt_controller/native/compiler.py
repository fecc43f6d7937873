"""`compile_law`: the control law as a shared library, which is named after its sources.

The build of the package imports this file before the package is installed: it may import the
standard library and the compiler of the contract only.
"""

from pathlib import Path

from rt_controller.contract.compiler import compile_library, library_name, remove_others

SOURCES = Path(__file__).with_name("c")
BUILT = Path(__file__).with_name("built")
"""where the compiled law is, in an installation and in a checkout"""
FLOAT = ("-DMDK_FLOAT",)
"""option with which all numbers are float"""


def law_library_name(options: tuple[str, ...] = ()) -> str:
    """File name of the law of the present sources for this kind of processor."""
    return library_name(f"law{len(options)}", [*SOURCES.glob("*.[ch]")], str(options))


def compile_law(folder: Path, options: tuple[str, ...] = ()) -> Path:
    """Compile the law into a folder, unless it is there; laws of other sources are removed.

    Raises:
        CompileError: there is no C compiler, or it does not compile them.
        OSError: the folder cannot be written.
    """
    library = folder / law_library_name(options)
    if not library.exists():
        folder.mkdir(parents=True, exist_ok=True)
        compile_library(sorted(SOURCES.glob("*.c")), library, SOURCES, options)
        remove_others(library, f"law{len(options)}")
    return library
