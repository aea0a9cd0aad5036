"""`handeye.rpc` is a thin contract on Zenoh, not a framework."""

from __future__ import annotations

import ast
import io
import tokenize
from pathlib import Path

import handeye.rpc

NO_CODE = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}


def lines_of_code(source: str) -> int:
    """Lines that hold code: not blank, no comment, no docstring."""
    code: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in NO_CODE:
            code.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            code.difference_update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return len(code)


def test_what_counts() -> None:
    source = '"""Title."""\n# comment\nx = """a\nb"""\n\n\ndef f():\n    """Doc\n\n    string."""\n    return x  # y\n'
    assert lines_of_code(source) == 4


def test_at_most_500_lines_of_code() -> None:
    files = sorted(Path(handeye.rpc.__path__[0]).rglob("*.py"))
    assert files
    assert sum(lines_of_code(path.read_text()) for path in files) <= 500
