"""The README's examples, run as they stand, against a taught stack."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.system.conftest import Lesson

pytestmark = [pytest.mark.system, pytest.mark.timeout(400)]

README = (Path(__file__).parents[2] / "README.md").read_text()


def blocks(language: str, word: str) -> list[str]:
    """The README's code blocks in `language` that contain `word`."""
    return [block for block in re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL) if word in block]


def environment(lesson: Lesson) -> dict[str, str]:
    stack = lesson.stack
    return os.environ | {
        "XDG_STATE_HOME": str(stack.state_dir.parent),
        "HANDEYE_URL": stack.url,
        "HANDEYE_TOKEN": stack.token,
    }


def done(lesson: Lesson, *command: str) -> str:
    """What the command printed; it must succeed."""
    ended = subprocess.run(command, env=environment(lesson), capture_output=True, text=True, timeout=120, check=False)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


def test_the_command_line(lesson: Lesson) -> None:
    (block,) = blocks("sh", "handeye run")
    lines = [line for line in block.splitlines() if " teach" not in line]  # the fixture has taught
    assert len(lines) == 2
    for line in lines:
        verb = shlex.split(line)[1:]
        output = done(lesson, sys.executable, "-m", "handeye.cli.main", *verb)
    assert "succeeded" in output


def test_python(lesson: Lesson) -> None:
    lesson.reset()
    lesson.place()
    (block,) = blocks("python", "handeye.client")
    output = done(lesson, sys.executable, "-c", block)
    assert output.startswith("succeeded\napproach ")


@pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not installed")
def test_http(lesson: Lesson) -> None:
    lesson.reset()
    lesson.place()
    (block,) = blocks("sh", "curl")
    output = done(lesson, "sh", "-ec", block)
    assert '"joints"' in output
    job = re.search(r'"id":\s*"([^"]+)"', output)
    assert job is not None
    assert lesson.client.follow(job[1], timeout=60.0).succeeded
