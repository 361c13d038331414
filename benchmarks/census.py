"""Count the files, lines and names of the sources: python -m benchmarks.census [FOLDER].

Lines of code are lines with a token that is no comment and no docstring; names are functions,
classes and constants of modules.
"""

import argparse
import ast
import io
import tokenize
from pathlib import Path

NOT_CODE = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}


def docstring_lines(tree: ast.AST) -> set[int]:
    """Return the lines that docstrings take."""
    found: set[int] = set()
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if not isinstance(body, list):
            continue
        for item in body:  # attributes of modules and records have docstrings too
            if isinstance(item, ast.Expr) and isinstance(item.value, ast.Constant):
                found.update(range(item.lineno, (item.end_lineno or item.lineno) + 1))
    return found


def count(path: Path) -> tuple[int, int, int, int]:
    """Return all lines of a file, those of code, those of docstrings, and its names."""
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    documented = docstring_lines(tree)
    code = {
        line
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type not in NOT_CODE
        for line in range(token.start[0], token.end[0] + 1)
    }
    names = sum(
        isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Assign | ast.AnnAssign)
        for node in tree.body
    )
    return text.count("\n"), len(code - documented), len(documented), names


def main() -> None:
    """Print a row a package and the sum."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("src/turnout"))
    root = parser.parse_args().folder
    rows: dict[str, list[int]] = {}
    for path in sorted(root.rglob("*.py")):
        package = path.relative_to(root).parts[0].removesuffix(".py")
        row = rows.setdefault(package, [0] * 5)
        for place, number in enumerate((1, *count(path))):
            row[place] += number
    rows["all"] = [sum(column) for column in zip(*rows.values(), strict=True)]
    print(f"{'package':<14}{'files':>7}{'lines':>8}{'code':>8}{'docs':>8}{'names':>8}")
    for package, row in rows.items():
        print(
            f"{package:<14}"
            + "".join(f"{n:>{w}}" for n, w in zip(row, (7, 8, 8, 8, 8), strict=True))
        )


if __name__ == "__main__":
    main()
