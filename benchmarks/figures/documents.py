"""Generated text in Markdown files, between `<!-- figures: NAME -->` and `<!-- end -->`."""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from rt_controller.contract.errors import ConfigError

_MARKER = re.compile(r"^<!-- figures: (\S+) -->$", re.MULTILINE)
_BLOCK = re.compile(
    r"^(<!-- figures: (\S+) -->\n)(?:(?!^<!-- figures).)*?^<!-- end -->$", re.DOTALL | re.MULTILINE
)


def replace_blocks(text: str, blocks: Mapping[str, str | None], where: str) -> str:
    """The text with the content of each block; a block whose text is None stays as it is.

    Raises:
        ConfigError: a marker names no block, or has no end.
    """
    found = list(_BLOCK.finditer(text))
    unknown = {match[2] for match in found} - blocks.keys()
    if unknown or len(found) != len(_MARKER.findall(text)):
        raise ConfigError(
            f"{where}: expected markers of {', '.join(blocks)}, each with <!-- end --> after it, "
            f"found {', '.join(sorted(unknown)) or 'one without an end'}. Correct the marker."
        )

    def replaced(match: re.Match[str]) -> str:
        block = blocks[match[2]]
        return match[0] if block is None else f"{match[1]}\n{block}\n\n<!-- end -->"

    return _BLOCK.sub(replaced, text)


def changed_files(files: Iterable[Path], blocks: Mapping[str, str | None]) -> dict[Path, str]:
    """The files whose blocks differ, with their new text."""
    texts = {file: file.read_text(encoding="utf-8") for file in files}
    new = {file: replace_blocks(text, blocks, str(file)) for file, text in texts.items()}
    return {file: text for file, text in new.items() if text != texts[file]}
