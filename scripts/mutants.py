"""Mutants of a Python module: small changes of its source that a good test notices.

Not changed, since no test should notice it: docstrings and other strings, annotations, decorators,
error messages, asserts, logging, ``__repr__``, ``__all__`` and what is for type checkers only.
"""

import ast
import hashlib
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate

ARITHMETIC = {"+": "-", "-": "+", "*": "/", "/": "*", "**": "*", "//": "*", "%": "//"}
SWAPPED = {"<": ">=", "<=": ">", ">": "<=", ">=": "<", "==": "!=", "!=": "==", "in": "not in"}
SWAPPED |= {"not in": "in", "is": "is not", "is not": "is", "and": "or", "or": "and"}
SWAPPED |= ARITHMETIC | {"|": "&", "&": "|"}
OPERATOR = re.compile(
    r"not\s+in\b|is\s+not\b|\b(?:is|in|and|or)\b|<<|>>|[<>=!]=|\*\*|//|[<>+*/%|&-]"
)
BOUNDARY = {"<": "<=", "<=": "<", ">": ">=", ">=": ">"}
CALLED = {"min": "max", "minimum": "maximum", "argmin": "argmax", "any": "all"}
CALLED |= {"floor": "ceil", "zeros": "ones"}
CALLED |= {other: name for name, other in CALLED.items()}
RETURNED = {"bool": "not ({})", "float": "1 + ({})", "int": "1 + ({})", "np.ndarray": "1 + ({})"}
RETURNED |= {"str": '""'}
QUIET = re.compile(r"^(warnings\.warn|print|cast|TypeVar|NewType|(logging|logger|log)\.\w+)$")
TRIVIAL = {"strict", "check_finite", "full_matrices", "rcond", "lower", "dtype", "encoding", "copy"}
"""Arguments by name that change nothing that counts."""
TYPES = {"None", "bool", "bytes", "complex", "float", "int", "list", "np.ndarray", "str", "tuple"}
LOGICAL = (ast.Compare, ast.BoolOp, ast.UnaryOp)
"""Conditions that are changed inside, not negated as a whole."""
Function = ast.FunctionDef | ast.AsyncFunctionDef
Edit = tuple[int, int, str]
"""First byte, byte after the last, and the text that replaces them."""


@dataclass(frozen=True)
class Mutant:
    """One change of a module; ``lines`` are those of its statement, ``names`` what it defines.

    ``function`` is the first and last line of the function in which it is, None at module level.
    """

    path: str
    line: int
    start: int
    end: int
    new: str
    before: str
    after: str
    lines: tuple[int, int]
    function: tuple[int, int] | None
    names: tuple[str, ...]

    @property
    def id(self) -> str:
        key = f"{self.path}|{self.line}|{self.start}|{self.end}|{self.new}"
        return hashlib.sha256(key.encode()).hexdigest()[:8]

    def text(self, source: bytes) -> bytes:
        """The source of the module with this change."""
        return source[: self.start] + self.new.encode() + source[self.end :]


def kept(n: ast.AST) -> bool:
    """Whether a node and all inside it stay as they are."""
    match n:
        case ast.Import() | ast.ImportFrom() | ast.Assert() | ast.JoinedStr():
            return True
        case ast.Expr(value=value):
            return isinstance(value, ast.Constant) or kept(value)
        case ast.Call(func=func):
            return bool(QUIET.match(ast.unparse(func)))
        case ast.Assign(targets=[ast.Name(id=name), *_]):
            return name == "__all__"
        case ast.ClassDef(bases=bases):
            return any(ast.unparse(b).startswith("Protocol") for b in bases)
        case ast.FunctionDef(name=name, decorator_list=decorators):
            overload = any("overload" in ast.unparse(d) for d in decorators)
            return overload or name in ("__repr__", "__str__")
        case ast.If(test=test):
            return "TYPE_CHECKING" in ast.unparse(test)
    return False


def inside(n: ast.AST) -> list[ast.AST]:
    """Nodes of a node that may be changed."""
    match n:
        case ast.Raise():
            return []
        case ast.ClassDef():
            return list(n.body)
        case ast.FunctionDef() | ast.AsyncFunctionDef():
            return [d for d in (*n.args.defaults, *n.args.kw_defaults) if d] + n.body
        case ast.Assign() | ast.AnnAssign():
            return [n.value] if n.value else []
        case ast.Call():
            named = [k for k in n.keywords if k.arg not in TRIVIAL]
            shape = ast.unparse(n.func).endswith("reshape")
            return [n.func] if shape else [n.func, *n.args, *named]
    return list(ast.iter_child_nodes(n))


class Module:
    """The source of a module, and its mutants."""

    def __init__(self, path: str, source: bytes):
        self.path, self.source = path, source
        self.starts = [0, *accumulate(map(len, source.splitlines(keepends=True)))]

    def span(self, n) -> tuple[int, int]:
        """First byte of a node and the byte after its last."""
        start = self.starts[n.lineno - 1] + n.col_offset
        return start, self.starts[n.end_lineno - 1] + n.end_col_offset

    def around(self, n, form: str) -> Edit:
        """Replace a node; ``{}`` stands for what it was."""
        start, end = self.span(n)
        return start, end, form.format(self.source[start:end].decode())

    def operator(self, left, right, swapped: dict[str, str]) -> Iterator[Edit]:
        """Replace the operator between two nodes."""
        start, stop = self.span(left)[1], self.span(right)[0]
        code = re.sub(rb"#.*", lambda comment: b" " * len(comment[0]), self.source[start:stop])
        at = OPERATOR.search(code.decode())
        new = swapped.get(" ".join(at[0].split())) if at else None
        if at and new:
            yield start + at.start(), start + at.end(), new

    def of_statement(self, n: ast.AST, function: Function | None) -> Iterator[Edit]:
        """Statements that are left out, returned values that are others, conditions negated."""
        match n:
            case ast.Raise() | ast.Break() | ast.Continue() | ast.Expr(value=ast.Call()):
                yield self.around(n, "pass")
            case ast.AugAssign():
                yield self.around(n, "pass")
                yield from self.operator(n.target, n.value, SWAPPED)
            case ast.Assign(targets=[ast.Subscript(), *_]):
                yield self.around(n, "pass")
            case ast.Assign(targets=[ast.Attribute(), *_]):
                if function is None or function.name != "__init__":
                    yield self.around(n, "pass")
            case ast.Return(value=value) if value and ast.unparse(value) != "None":
                kind = ast.unparse(function.returns) if function and function.returns else ""
                if kind != "bool" or not isinstance(value, (*LOGICAL, ast.Constant)):
                    yield self.around(value, RETURNED.get(kind, "None"))
            case ast.If(test=test) | ast.IfExp(test=test) if not isinstance(test, LOGICAL):
                yield self.around(test, "not ({})")
            case ast.comprehension(ifs=tests):
                yield from (self.around(t, "not ({})") for t in tests if not isinstance(t, LOGICAL))

    def of_operators(self, n: ast.AST) -> Iterator[Edit]:
        """Other operators and signs, and other bounds where counts are compared."""
        match n:
            case ast.Compare():
                sides = [n.left, *n.comparators]
                for a, b in zip(sides, n.comparators, strict=False):
                    yield from self.operator(a, b, SWAPPED)
                    if any(re.match(r"\d+$|len\(", ast.unparse(side)) for side in (a, b)):
                        yield from self.operator(a, b, BOUNDARY)  # changes nothing for reals
            case ast.BinOp():
                sides = [
                    s for s in (n.left, n.right) if isinstance(s, ast.Constant | ast.JoinedStr)
                ]
                words = any(not isinstance(getattr(s, "value", ""), int | float) for s in sides)
                types = isinstance(n.op, ast.BitOr) and ast.unparse(n.right) in TYPES
                if not words and not types:
                    yield from self.operator(n.left, n.right, SWAPPED)
            case ast.BoolOp():
                for a, b in zip(n.values, n.values[1:], strict=False):
                    yield from self.operator(a, b, SWAPPED)
            case ast.UnaryOp(op=ast.Not() | ast.USub()):
                yield self.span(n)[0], self.span(n.operand)[0], ""

    def of_values(self, n: ast.AST) -> Iterator[Edit]:
        """Other numbers, slices without an end, other functions, arguments left out."""
        match n:
            case ast.Constant(value=bool(v)):
                yield self.around(n, str(not v))
            case ast.Constant(value=int(v)):
                yield self.around(n, str(0 if v == 1 else v + 1))
            case ast.Constant(value=float(v)):
                near = [v + 1.0] if v in (0.0, 1.0) else [v * 3, v / 3]
                if v == 0.0 or 1e-9 < abs(v) < 1e9:
                    yield from (self.around(n, repr(float(f"{new:.4g}"))) for new in near)
            case ast.Slice():
                yield from ((*self.span(bound), "") for bound in (n.lower, n.upper) if bound)
            case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)):
                end = self.span(n.func)[1]
                if name in CALLED:
                    yield end - len(name), end, CALLED[name]
                some = len(n.args) + len(n.keywords) > 1 and not name[0].isupper()
                for k in [k for k in n.keywords if some and k.arg and k.arg not in TRIVIAL]:
                    start, stop = self.span(k)
                    comma = re.match(rb"\s*,\s*", self.source[stop:])
                    yield start, stop + (comma.end() if comma else 0), ""

    def mutant(self, edit: Edit, statement: ast.stmt, function: Function | None) -> Mutant | None:
        """A change with where it is; None if it's no Python."""
        start, end, new = edit
        changed = self.source[:start] + new.encode() + self.source[end:]
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                compile(changed, self.path, "exec")
        except SyntaxError:
            return None
        line = self.source.count(b"\n", 0, start) + 1
        before = self.source[self.starts[line - 1] : self.source.find(b"\n", end)]
        after = changed[self.starts[line - 1] : changed.find(b"\n", start + len(new.encode()))]
        body = getattr(statement, "body", None)
        last = max(statement.lineno, body[0].lineno - 1) if body else statement.end_lineno
        own = (function.body[0].lineno, function.end_lineno) if function else None
        targets = getattr(statement, "targets", [getattr(statement, "target", None)])
        targets = targets[0].elts if isinstance(targets[0], ast.Tuple) else targets
        names = () if function else tuple(t.id for t in targets if isinstance(t, ast.Name))
        lines = (statement.lineno, last)
        return Mutant(
            self.path, line, start, end, new, before.decode(), after.decode(), lines, own, names
        )

    def mutants(
        self, n: ast.AST, statement: ast.stmt | None = None, function: Function | None = None
    ) -> Iterator[Mutant]:
        """Mutants of a node and of those inside it."""
        if kept(n):
            return
        statement = n if isinstance(n, ast.stmt) else statement
        function = n if isinstance(n, Function) else function
        if statement is not None:
            edits = [*self.of_statement(n, function), *self.of_operators(n), *self.of_values(n)]
            changed = (self.mutant(edit, statement, function) for edit in edits)
            yield from (mutant for mutant in changed if mutant)
        for child in inside(n):
            yield from self.mutants(child, statement, function)


def drawn(every: list[Mutant], count: int, seed: int) -> list[Mutant]:
    """Some of the mutants of a module; most stay the same when it is moved or changed elsewhere."""

    def place(m: Mutant) -> str:
        return hashlib.sha256(f"{seed}|{m.before.strip()}|{m.after.strip()}".encode()).hexdigest()

    return sorted(sorted(every, key=place)[:count], key=lambda m: m.start)


def mutants(path: str, source: bytes) -> list[Mutant]:
    """Every mutant of a module, in the order of its lines."""
    found = Module(path, source).mutants(ast.parse(source))
    unique = {(m.start, m.end, m.new): m for m in found}
    return [unique[key] for key in sorted(unique)]
