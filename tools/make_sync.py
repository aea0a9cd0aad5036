"""Makes the synchronous client from the asynchronous one: client/handeye/client/_async -> _sync.

    tools/make_sync.py [TARGET]

TARGET is another folder to write to. Needs unasync and ruff (extra `test`), with the Python that has them.
"""

import subprocess
import sys
from pathlib import Path

import unasync

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "client" / "handeye" / "client" / "_async"
HEADER = "# Made by tools/make_sync.py from {}: change that, then `make sync`.\n"
WORDS = {
    "AsyncClient": "Client",
    "AsyncControl": "Control",
    "AsyncBaseTransport": "BaseTransport",
    "_async": "_sync",
    "aclose": "close",
    "aclosing": "closing",
    "aiter_bytes": "iter_bytes",
    "async_sleep": "sync_sleep",
}
PROSE = {"The client in tasks (asyncio); what it does in threads is made from it by": "The client in threads; made by"}


def main(target: Path) -> None:
    """Writes the synchronous client into `target`, formatted as the rest."""
    target.mkdir(exist_ok=True)
    rule = unasync.Rule(f"{SOURCE}/", f"{target}/", additional_replacements=WORDS)
    sources = sorted(SOURCE.glob("*.py"))
    unasync.unasync_files([str(source) for source in sources], [rule])
    for old in target.glob("*.py"):
        if not (SOURCE / old.name).exists():
            old.unlink()
    for source in sources:
        made = target / source.name
        text = made.read_text()
        for old_words, new_words in PROSE.items():
            text = text.replace(old_words, new_words)
        made.write_text(HEADER.format(source.relative_to(ROOT)) + text)
    settings = ("--quiet", "--config", str(ROOT / "pyproject.toml"))
    ruff = (sys.executable, "-m", "ruff")
    for command in (("check", "--fix", "--unsafe-fixes", "--select", "I,SIM117,UP028"), ("format",)):
        subprocess.run([*ruff, *command, *settings, str(target)], check=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else SOURCE.with_name("_sync"))
