"""Find docstrings and comments that cannot be understood alone: plain_words.py PATH...

Print path:line and the text of each docstring that opens with What, Where, How or Which, and of
each comment whose first word continues a noun that is not there, as in "# of the port". A capital
letter begins a sentence, as in "# By default ...". Exit with status 1 if there is any.
"""

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

QUESTION = re.compile(r"(What|Where|How|Which)\b")
CONTINUATION = re.compile(
    r"(of|in|by|for|with|without|within|from|at|on|as|than|among|between|which|whose|that|where"
    r"|Of|Which|Whose)\b"
)
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def docstrings(text: str) -> Iterator[tuple[int, str]]:
    """Yield the line and the text of each docstring of a Python file."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, DOCUMENTED) and (docstring := ast.get_docstring(node)):
            yield node.body[0].lineno, docstring


def comments(text: str, suffix: str) -> Iterator[tuple[int, str]]:
    """Yield the line and the text of each comment. Lines below one another are one comment."""
    if suffix == ".py":
        tokens = tokenize.generate_tokens(io.StringIO(text).readline)
        starts = [token.start for token in tokens if token.type == tokenize.COMMENT]
    else:
        matches = (re.search(r"(?:^|\s)//", line) for line in text.splitlines())
        starts = [(row, match.end() - 2) for row, match in enumerate(matches, 1) if match]
    lines, rows = text.splitlines(), {row for row, _ in starts}
    for row, column in starts:
        if lines[row - 1][:column].strip() or row - 1 not in rows:
            yield row, lines[row - 1][column:].lstrip("#/ ")


status = 0
folders_and_files = [Path(path) for path in sys.argv[1:]]
if missing := [str(path) for path in folders_and_files if not path.exists()]:
    sys.exit(f"not found: {', '.join(missing)}")
for path in sorted({file for one in folders_and_files for file in (one, *one.rglob("*"))}):
    if path.suffix in (".py", ".js"):
        source = path.read_text(encoding="utf-8")
        questions = docstrings(source) if path.suffix == ".py" else ()
        finds = [(row, text) for row, text in questions if QUESTION.match(text)]
        finds += [c for c in comments(source, path.suffix) if CONTINUATION.match(c[1])]
        for row, text in sorted(finds):
            print(f"{path}:{row}: {text.splitlines()[0]}")
            status = 1
sys.exit(status)
