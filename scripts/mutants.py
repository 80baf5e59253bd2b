"""Mutants of a Python module: small changes of its source that a good test notices.

Not changed, since no test should notice it: docstrings and other strings, annotations, decorators,
error messages, asserts, logging, ``__repr__``, ``__all__`` and what is for type checkers only.
"""

import ast
import hashlib
import re
import warnings
from dataclasses import dataclass

COMPARED = {
    ast.Lt: ("<", ">="), ast.LtE: ("<=", ">"), ast.Gt: (">", "<="), ast.GtE: (">=", "<"),
    ast.Eq: ("==", "!="), ast.NotEq: ("!=", "=="), ast.In: ("in", "not in"),
    ast.NotIn: ("not in", "in"), ast.Is: ("is", "is not"), ast.IsNot: ("is not", "is"),
}  # fmt: skip
BOUNDARY = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">"}
ARITHMETIC = {
    ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*"),
    ast.Pow: ("**", "*"), ast.FloorDiv: ("//", "*"), ast.Mod: ("%", "//"),
    ast.BitOr: ("|", "&"), ast.BitAnd: ("&", "|"),
}  # fmt: skip
PAIRS = [
    ("min", "max"), ("minimum", "maximum"), ("argmin", "argmax"), ("any", "all"),
    ("floor", "ceil"), ("zeros", "ones"),
]  # fmt: skip
CALLED = {a: b for pair in PAIRS for a, b in (pair, pair[::-1])}
RETURNED = {"bool": "not ({})", "float": "1 + ({})", "int": "1 + ({})", "str": '""'}
RETURNED |= {"np.ndarray": "1 + ({})"}
QUIET = re.compile(r"^(warnings\.warn|print|cast|TypeVar|NewType|(logging|logger|log)\.\w+)$")
TRIVIAL = {"strict", "check_finite", "full_matrices", "rcond", "lower", "dtype", "encoding", "copy"}
"""Arguments by name that change nothing that counts."""
TYPES = {"None", "bool", "bytes", "complex", "float", "int", "list", "np.ndarray", "str", "tuple"}


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


class _Finder:
    def __init__(self, path: str, source: bytes):
        self.path, self.source = path, source
        self.found: dict[tuple[int, int, str], Mutant] = {}
        self.starts = [0]
        for line in source.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))
        self.function: ast.FunctionDef | ast.AsyncFunctionDef | None = None
        self.statement: ast.stmt | None = None

    def start(self, n) -> int:
        return self.starts[n.lineno - 1] + n.col_offset

    def end(self, n) -> int:
        return self.starts[n.end_lineno - 1] + n.end_col_offset

    def add(self, start: int, end: int, new: str) -> None:
        changed = self.source[:start] + new.encode() + self.source[end:]
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                compile(changed, self.path, "exec")
        except SyntaxError:
            return
        line = self.source.count(b"\n", 0, start) + 1
        own, f, end_of = self.statement, self.function, self.source.find
        body = getattr(own, "body", None)
        last = max(own.lineno, body[0].lineno - 1) if body else own.end_lineno
        target = own.targets[0] if isinstance(own, ast.Assign) else getattr(own, "target", None)
        defined = target.elts if isinstance(target, ast.Tuple) else [target]
        names = [t.id for t in defined if f is None and isinstance(t, ast.Name)]
        before = self.source[self.starts[line - 1] : end_of(b"\n", end)]
        after = changed[self.starts[line - 1] : changed.find(b"\n", start + len(new.encode()))]
        self.found.setdefault((start, end, new), Mutant(
            self.path, line, start, end, new, before.decode(), after.decode(), (own.lineno, last),
            (f.body[0].lineno, f.end_lineno) if f else None, tuple(names),
        ))  # fmt: skip

    def between(self, left, right, old: str, new: str) -> None:
        """Replace an operator between two nodes."""
        start, stop = self.end(left), self.start(right)
        at = re.search(re.escape(old).replace("\\ ", r"\s+"), self.source[start:stop].decode())
        if at:
            self.add(start + at.start(), start + at.end(), new)

    def around(self, n, form: str) -> None:
        start, end = self.start(n), self.end(n)
        self.add(start, end, form.format(self.source[start:end].decode()))

    def visit(self, n) -> None:
        """What may be changed in a node, then in those inside it."""
        kind = type(n).__name__
        outer = self.function, self.statement
        if isinstance(n, ast.stmt):
            self.statement = n
        inside = getattr(self, f"in_{kind}", self.children)(n)
        for child in inside:
            self.visit(child)
        self.function, self.statement = outer

    @staticmethod
    def children(n) -> list[ast.AST]:
        return list(ast.iter_child_nodes(n))

    @staticmethod
    def nothing(n) -> list[ast.AST]:
        return []

    in_Import = in_ImportFrom = in_Assert = in_JoinedStr = nothing

    def in_ClassDef(self, n):
        return [] if any(ast.unparse(b).startswith("Protocol") for b in n.bases) else n.body

    def in_FunctionDef(self, n):
        if n.name in ("__repr__", "__str__") or any("overload" in ast.unparse(d)
                                                   for d in n.decorator_list):  # fmt: skip
            return []
        self.function = n
        return [d for d in (*n.args.defaults, *n.args.kw_defaults) if d] + n.body

    in_AsyncFunctionDef = in_FunctionDef

    def removed(self, n) -> None:
        self.add(self.start(n), self.end(n), "pass")

    def in_Raise(self, n):
        self.removed(n)
        return []

    def in_Break(self, n):
        self.removed(n)
        return []

    in_Continue = in_Break

    def in_Expr(self, n):
        if isinstance(n.value, ast.Call) and not QUIET.match(ast.unparse(n.value.func)):
            self.removed(n)
        return [] if isinstance(n.value, ast.Constant) else [n.value]

    def in_AugAssign(self, n):
        self.removed(n)
        old, new = ARITHMETIC.get(type(n.op), ("", ""))
        if old:
            self.between(n.target, n.value, f"{old}=", f"{new}=")
        return [n.target, n.value]

    def in_Assign(self, n):
        if any(isinstance(t, ast.Name) and t.id == "__all__" for t in n.targets):
            return []
        if isinstance(n.targets[0], ast.Subscript) or (
            isinstance(n.targets[0], ast.Attribute) and self.function.name != "__init__"
        ):
            self.removed(n)
        return [n.value]

    def in_AnnAssign(self, n):
        return [n.value] if n.value else []

    def in_Return(self, n):
        if n.value is None or (isinstance(n.value, ast.Constant) and n.value.value is None):
            return []
        told = ast.unparse(self.function.returns) if self.function.returns else ""
        logical = isinstance(n.value, ast.Compare | ast.BoolOp | ast.UnaryOp | ast.Constant)
        if not (told == "bool" and logical):
            self.around(n.value, RETURNED.get(told, "None"))
        return [n.value]

    def in_If(self, n):
        if "TYPE_CHECKING" in ast.unparse(n.test):
            return []
        self.negated(n.test)
        return self.children(n)

    def negated(self, test) -> None:
        if not isinstance(test, ast.Compare | ast.BoolOp | ast.UnaryOp):
            self.around(test, "not ({})")

    def in_IfExp(self, n):
        self.negated(n.test)
        return self.children(n)

    def in_comprehension(self, n):
        for test in n.ifs:
            self.negated(test)
        return self.children(n)

    def in_Compare(self, n):
        sides = [n.left, *n.comparators]
        for a, op, b in zip(sides, n.ops, sides[1:], strict=False):
            old, new = COMPARED[type(op)]
            self.between(a, b, old, new)
            counted = any(
                (isinstance(s, ast.Constant) and type(s.value) is int)
                or ast.unparse(s).startswith("len(")
                for s in (a, b)
            )
            if type(op) in BOUNDARY and counted:  # for real numbers this changes nothing
                self.between(a, b, old, BOUNDARY[type(op)])
        return self.children(n)

    def in_BinOp(self, n):
        words = any(isinstance(s, ast.Constant | ast.JoinedStr) and not isinstance(
            getattr(s, "value", ""), int | float) for s in (n.left, n.right))  # fmt: skip
        types = isinstance(n.op, ast.BitOr) and ast.unparse(n.right) in TYPES
        if type(n.op) in ARITHMETIC and not words and not types:
            self.between(n.left, n.right, *ARITHMETIC[type(n.op)])
        return self.children(n)

    def in_BoolOp(self, n):
        old, new = ("and", "or") if isinstance(n.op, ast.And) else ("or", "and")
        for a, b in zip(n.values, n.values[1:], strict=False):
            self.between(a, b, old, new)
        return self.children(n)

    def in_UnaryOp(self, n):
        if isinstance(n.op, ast.Not | ast.USub):
            self.add(self.start(n), self.start(n.operand), "")
        return [n.operand]

    def in_Constant(self, n):
        v = n.value
        if isinstance(v, bool):
            self.around(n, str(not v))
        elif isinstance(v, int):
            self.around(n, str(0 if v == 1 else v + 1))
        elif isinstance(v, float) and v in (0.0, 1.0):
            self.around(n, "1.0" if v == 0.0 else "2.0")
        elif isinstance(v, float) and 1e-9 < abs(v) < 1e9:
            for new in (v * 3, v / 3):
                self.around(n, f"{new:.4g}" if "." in f"{new:.4g}" else repr(float(f"{new:.4g}")))
        return []

    def in_Call(self, n):
        name = ast.unparse(n.func)
        if QUIET.match(name):
            return []
        last = name.rsplit(".", 1)[-1]
        if last in CALLED and name[-1] != ")":
            self.add(self.end(n.func) - len(last), self.end(n.func), CALLED[last])
        named = [k for k in n.keywords if k.arg not in TRIVIAL]
        for k in named:
            if k.arg and not last[0].isupper() and len(n.args) + len(n.keywords) > 1:
                stop = self.end(k)
                after = re.match(rb"\s*,\s*", self.source[stop:])
                self.add(self.start(k), stop + (after.end() if after else 0), "")
        return [n.func] if last == "reshape" else [n.func, *n.args, *named]

    def in_Slice(self, n):
        for bound in (n.lower, n.upper):
            if bound is not None:
                self.add(self.start(bound), self.end(bound), "")
        return self.children(n)


def drawn(every: list[Mutant], count: int, seed: int) -> list[Mutant]:
    """Some of the mutants of a module; most stay the same when it is moved or changed elsewhere."""

    def place(m: Mutant) -> str:
        return hashlib.sha256(f"{seed}|{m.before.strip()}|{m.after.strip()}".encode()).hexdigest()

    return sorted(sorted(every, key=place)[:count], key=lambda m: m.start)


def mutants(path: str, source: bytes) -> list[Mutant]:
    """Every mutant of a module, in the order of its lines."""
    finder = _Finder(path, source)
    tree = ast.parse(source)
    for node in tree.body:
        finder.visit(node)
    return sorted(finder.found.values(), key=lambda m: (m.start, m.end, m.new))
