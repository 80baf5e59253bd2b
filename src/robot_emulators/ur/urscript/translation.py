"""Translates URScript to Python: tokens to the tree of a generator function, by recursive descent.

Each function of a program becomes a generator function, which yields where it waits for the next
control cycle. Variables are called ``v_name``, functions ``f_name``, those of the controller
``b_name``, operators ``o_…``. Every node has the place of its token or of the node around it, so
that Python's tracebacks locate a program's error. Variables of the program itself are Python's
globals; a function assigns to the nearest enclosing variable of a name, else to one of its own.
"""

import ast
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from types import CodeType
from typing import TypeVar

from robot_emulators.ur.urscript import tokens as lexer
from robot_emulators.ur.urscript.functions import Act, Builtin
from robot_emulators.ur.urscript.tokens import Token
from robot_emulators.ur.urscript.values import NO_NAME, ScriptFaultError

T = TypeVar("T", bound=ast.AST)
FILE = "<urscript>"
"""File name of a program's text in Python's tracebacks."""
_DEEPEST = 60
"""Deepest nesting of blocks and brackets, more than any program that a person wrote."""
_LONGEST_CHAIN = 400
"""Most operators in a row: they nest in Python's tree, whose depth the compiler bounds."""
_LEVELS = (
    ("or", "xor"),
    ("and",),
    ("==", "!=", "<>", "<", ">", "<=", ">="),
    ("+", "-"),
    ("*", "/", "%"),
    ("^",),
)
OPERATORS = {
    "+": "add", "-": "subtract", "*": "multiply", "/": "divide", "%": "modulo", "^": "power",
    "<": "less", ">": "more", "<=": "most", ">=": "least", "xor": "xor",
}  # fmt: skip
"""Sign → name of the function ``o_name`` that computes it; the other signs are Python's own."""
_SILENT = ("pass", "enter_critical", "exit_critical")
"""Keywords without effect: threads switch only where they wait, so no section is critical."""
_FRESH = (ast.Constant, ast.List, ast.Compare, ast.BoolOp, ast.UnaryOp)
"""Nodes that make a new value, which no other variable shares and nobody need copy."""


@dataclass
class _Scope:
    """Names of the variables of one URScript function: its parameters, those assigned without a
    declaration (``plain``), and those declared ``local`` or global (``shared``); ``around`` is the
    scope of the enclosing function."""

    around: "_Scope | None"
    parameters: set[str] = field(default_factory=set)
    plain: set[str] = field(default_factory=set)
    local: set[str] = field(default_factory=set)
    shared: set[str] = field(default_factory=set)

    @property
    def bound(self) -> set[str]:
        """Names of the variables that belong to this function itself, as far as is known."""
        return self.parameters | self.plain | self.local


@dataclass(frozen=True, eq=False)
class Code:
    """A compiled URScript program.

    Attributes:
        name: name of the program.
        secondary: whether it runs beside the main program.
        code: code of a Python module with the generator function ``program``.
        builtins: controller functions by the names under which the code calls them.
    """

    name: str
    secondary: bool
    code: CodeType
    builtins: Mapping[str, Act]


def translated(text: str, table: Mapping[str, Builtin]) -> Code:
    """Translate a URScript text to Python code, which may call the functions of ``table``. Raises a
    `ScriptFaultError`, with its place, for a syntax error or a call of an unknown function.
    """
    return _Translator(lexer.tokens(text), table).program()


class _Translator:
    def __init__(self, tokens: list[Token], table: Mapping[str, Builtin]) -> None:
        self._tokens, self._table = tokens, table
        self._at = self._depth = 0
        self._own = {
            name.text for key, name in pairwise(tokens) if key.kind in ("def", "sec", "thread")
        }
        self._called: set[str] = set()
        self._top = self._scope = _Scope(None)
        self._functions: list[tuple[_Scope, ast.FunctionDef]] = []

    def program(self) -> Code:
        """Translate the whole text; if it is one function, that function is the program."""
        start = self._tokens[0]
        name, secondary = "unnamed", False
        if self._is_whole():
            key, title = self._take("def", "sec"), self._take(lexer.NAME)
            self._take("(")
            self._take(")")
            name, secondary = title.text, key.text == "sec"
            body = self._body("end")
            self._take("end")
            self._skip_lines()
        else:
            body = self._block(lexer.END)
        if self._next().kind != lexer.END:
            raise self._wrong(self._next())
        program = _generator(start, "program", [], body)
        shared = set[str]().union(
            self._top.plain, self._top.local, self._top.shared,
            *(scope.shared for scope, _ in self._functions),
        )  # fmt: skip
        _declare(program, shared, set())
        for scope, function in self._functions:
            self._resolve(scope, function, shared)
        module = ast.fix_missing_locations(ast.Module([program], []))
        acts = {f"b_{called}": self._table[called].act for called in self._called}
        return Code(name, secondary, compile(module, FILE, "exec"), acts)

    def _is_whole(self) -> bool:
        """Whether the whole text is a single function without parameters."""
        self._skip_lines()
        kinds = [token.kind for token in self._tokens[self._at :]]
        marks = [token.text for token in self._tokens[self._at + 2 : self._at + 4]]
        if kinds[0] not in ("def", "sec") or marks != ["(", ")"]:
            return False
        depth = 0
        for k, kind in enumerate(kinds):
            depth += (kind in ("def", "sec", "thread", "if", "while")) - (kind == "end")
            if depth == 0:
                return all(kind in (lexer.LINE, lexer.END) for kind in kinds[k + 1 :])
        return True

    def _resolve(self, scope: _Scope, function: ast.FunctionDef, shared: set[str]) -> None:
        """Declare each variable that ``function`` assigns as Python's global (if in ``shared``, the
        program's variables), nonlocal or local."""
        enclosing, around = set[str](), scope.around
        while around is not None and around is not self._top:
            enclosing |= around.bound - around.shared
            around = around.around
        free = scope.plain - scope.parameters - scope.local - scope.shared
        _declare(function, scope.shared | (free & shared - enclosing), free & enclosing)

    # ---- tokens ------------------------------------------------------------------------------

    def _next(self) -> Token:
        return self._tokens[self._at]

    def _take(self, *kinds: str) -> Token:
        token = self._next()
        if token.kind not in kinds and token.text not in kinds:
            raise self._wrong(token)
        self._at += token.kind != lexer.END
        return token

    def _seen(self, *marks: str) -> Token | None:
        """Consume and return the next token if it is one of these marks or keywords; else None."""
        token = self._next()
        if token.text in marks and token.kind != lexer.TEXT:
            self._at += 1
            return token
        return None

    @staticmethod
    def _wrong(token: Token) -> ScriptFaultError:
        return ScriptFaultError(f"syntax_error_on_line:{token.line}:", token.line, token.column)

    def _skip_lines(self) -> None:
        while self._next().kind == lexer.LINE:
            self._at += 1

    def _deeper(self) -> None:
        self._depth += 1
        if self._depth > _DEEPEST:
            token = self._next()
            raise ScriptFaultError("nested too deeply", token.line, token.column)

    # ---- statements --------------------------------------------------------------------------

    def _block(self, *ends: str) -> list[ast.stmt]:
        """Translate statements up to one of these end tokens; functions are put first.
        A statement ends where it is complete: a line's end may follow, and need not."""
        self._deeper()
        functions: list[ast.stmt] = []
        rest: list[ast.stmt] = []
        while True:
            while self._next().kind == lexer.LINE or self._next().text == ";":
                self._at += 1
            token = self._next()
            if token.kind in ends:
                self._depth -= 1
                return functions + rest
            statement = self._statement()
            if statement is not None:
                kind = functions if isinstance(statement, ast.FunctionDef) else rest
                kind.append(_located(token, statement))

    def _body(self, *ends: str) -> list[ast.stmt]:
        self._take(":")
        return self._block(*ends) or [ast.Pass()]

    def _statement(self) -> ast.stmt | None:
        token = self._next()
        if token.kind in ("def", "sec", "thread"):
            return self._function()
        if token.kind in ("if", "while", "return", "break", "continue", "halt", "kill", "join"):
            self._at += 1
            return self._keyword(token)
        if token.kind in _SILENT:
            self._at += 1
            return None
        scope = self._seen("global", "local")
        target = self._expression()
        if self._seen("="):
            self._skip_lines()
            return self._assign(token, scope.text if scope else "", target)
        if scope is not None:
            raise self._wrong(self._next())
        return ast.Expr(target)

    def _assign(self, token: Token, scope: str, target: ast.expr) -> ast.stmt:
        value = _own_value(self._expression())
        if isinstance(target, ast.Name):
            names = {"global": self._scope.shared, "local": self._scope.local}
            names.get(scope, self._scope.plain).add(target.id[2:])
            target.ctx = ast.Store()
            return ast.Assign([target], value)
        if isinstance(target, ast.Call) and getattr(target.func, "id", "") == "get":
            return ast.Expr(_call(token, "put", value, *target.args))
        raise self._wrong(token)

    def _keyword(self, token: Token) -> ast.stmt:
        match token.kind:
            case "if":
                return self._if(token)
            case "while":
                test = _truth(self._expression())
                body = [ast.Expr(_call(token, "spend")), *self._body("end")]
                self._take("end")
                return ast.While(test, body, [])
            case "return":
                bare = self._next().kind in (lexer.LINE, "end")
                return ast.Return(None if bare else self._expression())
            case "halt":
                return ast.Raise(_name("ProgramEndsError"), None)
            case "kill":
                return ast.Expr(_call(token, "kill", self._expression()))
            case "join":
                return ast.Expr(ast.YieldFrom(_call(token, "join", self._expression())))
        return ast.Break() if token.kind == "break" else ast.Continue()

    def _if(self, token: Token) -> ast.stmt:
        test = _truth(self._expression())
        body = self._body("elif", "else", "end")
        otherwise: list[ast.stmt] = []
        if following := self._seen("elif"):
            otherwise = [_located(following, self._if(following))]
        else:
            if self._seen("else"):
                otherwise = self._body("end")
            self._take("end")
        return ast.If(test, body, otherwise)

    def _function(self) -> ast.stmt:
        start = self._take("def", "sec", "thread")
        name = self._take(lexer.NAME)
        around, self._scope = self._scope, _Scope(self._scope)
        defaults: list[ast.expr] = []
        names: list[str] = []
        self._take("(")
        while not self._seen(")"):
            names.append(self._take(lexer.NAME).text)
            if self._seen("="):
                defaults.append(self._expression())
            elif defaults:
                raise self._wrong(self._next())
            self._comma(")")
        self._scope.parameters.update(names)
        function = _generator(start, f"f_{name.text}", names, self._body("end"))
        self._take("end")
        function.args.defaults = defaults
        self._functions.append((self._scope, function))
        self._scope = around
        return function

    # ---- expressions -------------------------------------------------------------------------

    def _expression(self) -> ast.expr:
        self._deeper()
        tree = self._level(0)
        self._depth -= 1
        return tree

    def _level(self, number: int) -> ast.expr:
        if number == len(_LEVELS):
            return self._unary()
        left = self._level(number + 1)
        count = 0
        while (sign := self._seen(*_LEVELS[number])) is not None:
            self._skip_lines()
            left = _located(sign, _operation(sign, left, self._level(number + 1)))
            count += 1
            if count > _LONGEST_CHAIN:
                raise ScriptFaultError("nested too deeply", sign.line, sign.column)
        return left

    def _unary(self) -> ast.expr:
        sign = self._seen("not", "-", "+")
        if sign is None:
            return self._postfix(self._atom())
        self._deeper()
        operand = self._level(2) if sign.text == "not" else self._unary()
        self._depth -= 1
        if sign.text == "not":
            return _located(sign, ast.UnaryOp(ast.Not(), _truth(operand)))
        return operand if sign.text == "+" else _call(sign, "o_negative", operand)

    def _postfix(self, target: ast.expr) -> ast.expr:
        while True:
            if token := self._seen("["):
                target = _call(token, "get", target, self._expression())
                while self._seen(","):  # an element of a matrix
                    target = _call(token, "get", target, self._expression())
                self._take("]")
            elif token := self._seen("."):
                member = self._take(lexer.NAME)
                target = _call(token, "get", target, ast.Constant(member.text))
            else:
                return target

    def _atom(self) -> ast.expr:
        token = self._next()
        kind = token.kind
        self._at += kind != lexer.END
        if kind in (lexer.NUMBER, lexer.TEXT, "True", "False"):
            return _located(token, ast.Constant(_literal(token)))
        if kind == lexer.NAME:
            variable = _located(token, _name(f"v_{token.text}"))
            return self._call(token) if self._seen("(") else variable
        if kind == "run":
            name = self._take(lexer.NAME)
            self._take("(")
            if name.text not in self._own:
                raise ScriptFaultError(NO_NAME.format(name.text), name.line, name.column)
            return _call(token, "run", self._own_call(name))
        if kind == lexer.POSE or (token.text == "[" and kind == lexer.MARK):
            items = self._items()
            if kind != lexer.POSE:
                return _located(token, ast.List(items, ast.Load()))
            if len(items) == 1:  # an element of a variable p
                return _call(token, "get", _name("v_p"), items[0])
            if len(items) != 6:
                raise ScriptFaultError("a pose has six elements", token.line, token.column)
            return _call(token, "Pose", ast.List(items, ast.Load()))
        if token.text == "(" and kind == lexer.MARK:
            inner = self._expression()
            self._take(")")
            return inner
        raise self._wrong(token)

    def _comma(self, end: str) -> None:
        if self._next().text != end:
            self._take(",")

    def _items(self) -> list[ast.expr]:
        items = []
        while not self._seen("]"):
            items.append(_own_value(self._expression()))
            self._comma("]")
        return items

    def _arguments(self) -> tuple[list[ast.expr], dict[str, ast.expr]]:
        """Parse the arguments of a call; return positional ones and keyword → value."""
        places: list[ast.expr] = []
        names: dict[str, ast.expr] = {}
        while not self._seen(")"):
            following = self._tokens[self._at + 1] if self._next().kind == lexer.NAME else None
            if following is not None and following.text == "=" and following.kind == lexer.MARK:
                keyword = self._take(lexer.NAME)
                if keyword.text in names:
                    raise self._wrong(keyword)
                self._at += 1
                names[keyword.text] = self._expression()
            elif names:
                raise self._wrong(self._next())
            else:
                places.append(self._expression())
            self._comma(")")
        return places, names

    def _own_call(self, name: Token) -> ast.Call:
        places, names = self._arguments()
        call = _call(name, f"f_{name.text}", *places)
        call.keywords = [ast.keyword(f"v_{key}", value) for key, value in names.items()]
        return call

    def _call(self, name: Token) -> ast.expr:
        if name.text in self._own:
            return _located(name, ast.YieldFrom(self._own_call(name)))
        builtin = self._table.get(name.text)
        if builtin is None:
            raise ScriptFaultError(NO_NAME.format(name.text), name.line, name.column)
        places, names = self._arguments()
        try:
            builtin.signature.bind(None, *places, **names)
        except TypeError as error:
            raise ScriptFaultError(f"{name.text}: {error}", name.line, name.column) from None

        def checked(parameter: str, value: ast.expr) -> ast.expr:
            kind = builtin.kinds.get(parameter)
            words = ast.Constant(f"{name.text}: {parameter}")
            return value if kind is None else _call(name, f"as_{kind}", value, words)

        self._called.add(name.text)
        given = [checked(*pair) for pair in zip(builtin.parameters, places, strict=False)]
        call = _call(name, f"b_{name.text}", _name("context"), *given)
        call.keywords = [ast.keyword(key, checked(key, value)) for key, value in names.items()]
        return _located(name, ast.YieldFrom(call)) if builtin.waits else call


def _generator(
    place: Token, name: str, parameters: list[str], body: list[ast.stmt]
) -> ast.FunctionDef:
    """Make the AST of a generator function at token ``place``; it first copies its arguments."""
    first: list[ast.stmt] = [
        ast.If(ast.Constant(False), [ast.Expr(ast.Yield(None))], []),
        ast.Expr(_call(place, "spend")),
    ]
    for parameter in parameters:
        copy = _call(place, "copied", _name(f"v_{parameter}"))
        first.append(ast.Assign([ast.Name(f"v_{parameter}", ast.Store())], copy))
    arguments = ast.arguments(
        posonlyargs=[], args=[ast.arg(f"v_{parameter}") for parameter in parameters],
        kwonlyargs=[], kw_defaults=[], defaults=[],
    )  # fmt: skip
    return _located(place, ast.FunctionDef(name, arguments, first + body, []))


def _declare(function: ast.FunctionDef, shared: set[str], enclosing: set[str]) -> None:
    for kind, names in ((ast.Global, shared), (ast.Nonlocal, enclosing)):
        if names:
            function.body.insert(0, kind([f"v_{name}" for name in sorted(names)]))


def _located(place: Token, node: T) -> T:
    """Return an AST node; if it has no line and column, set those of token ``place``."""
    if not hasattr(node, "lineno"):
        column = place.column - 1
        more = {"lineno": place.line, "end_lineno": place.line, "col_offset": column}
        for key, value in (more | {"end_col_offset": column + 1}).items():
            setattr(node, key, value)
    return node


def _name(name: str) -> ast.Name:
    return ast.Name(name, ast.Load())


def _call(place: Token, name: str, *arguments: ast.expr) -> ast.Call:
    return _located(place, ast.Call(_name(name), list(arguments), []))


def _truth(test: ast.expr) -> ast.expr:
    sure = isinstance(test, ast.Compare | ast.BoolOp | ast.UnaryOp)
    return test if sure else ast.Call(_name("truth"), [test], [])


def _own_value(value: ast.expr) -> ast.expr:
    """AST of an expression that copies a list or struct, so that no two variables share it."""
    return value if isinstance(value, _FRESH) else ast.Call(_name("copied"), [value], [])


def _operation(sign: Token, left: ast.expr, right: ast.expr) -> ast.expr:
    if sign.text in ("and", "or"):
        act: ast.boolop = ast.And() if sign.text == "and" else ast.Or()
        return ast.BoolOp(act, [_truth(left), _truth(right)])
    if sign.text in ("==", "!=", "<>"):
        equal: ast.cmpop = ast.Eq() if sign.text == "==" else ast.NotEq()
        return ast.Compare(left, [equal], [right])
    return _call(sign, f"o_{OPERATORS[sign.text]}", left, right)


def _literal(token: Token) -> float | int | bool | str:
    word = token.text
    if token.kind == lexer.TEXT:
        return word[1:-1]
    if token.kind != lexer.NUMBER:
        return word == "True"
    if word[:2] in ("0x", "0X"):
        value: float | int = int(word, 16)
    else:
        value = int(word) if word.isdigit() and len(word) < 16 else float(word)
    if value > 1e300:
        raise ScriptFaultError("a number is too large", token.line, token.column)
    return value
