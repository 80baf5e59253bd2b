"""URScript to Python: tokens to the tree of a generator function, by recursive descent.

Each function of a program becomes a generator function, which yields where it waits for the next
control cycle. Variables are called ``v_name``, functions ``f_name``, those of the controller
``b_name``, operators ``o_…``; every node has the place of its token, so that Python's tracebacks
tell where a program failed. Variables of the program itself are Python's globals; a function
assigns to the nearest variable of a name that is assigned around it, else to one of its own.
"""

import ast
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TypeVar

from robot_emulators.ur.urscript import tokens as lexer
from robot_emulators.ur.urscript.functions import Builtin
from robot_emulators.ur.urscript.tokens import Token
from robot_emulators.ur.urscript.values import NO_NAME, ScriptFaultError

T = TypeVar("T", bound=ast.AST)
_DEEPEST = 60
"""Nested blocks and brackets; deeper than any program that a person wrote."""
_LONGEST_CHAIN = 400
"""Operators in a row, as they nest in Python's tree, whose depth the compiler bounds."""
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
"""Sign → name of the function ``o_name`` that works it out; the others are Python's own."""
_SILENT = ("pass", "enter_critical", "exit_critical")
"""Threads change only where one of them waits: critical sections need nothing."""
_FRESH = (ast.Constant, ast.List, ast.Compare, ast.BoolOp, ast.UnaryOp)
"""Nodes whose value nobody else has."""


@dataclass
class _Scope:
    """Variables of a function: parameters, those assigned without a scope, and with one."""

    around: "_Scope | None"
    parameters: set[str] = field(default_factory=set)
    plain: set[str] = field(default_factory=set)
    local: set[str] = field(default_factory=set)
    shared: set[str] = field(default_factory=set)

    @property
    def bound(self) -> set[str]:
        """Variables that are this function's own, as far as is known."""
        return self.parameters | self.plain | self.local


@dataclass(frozen=True)
class Translation:
    """A program in Python.

    Attributes:
        name: of the program.
        secondary: it runs beside the program that plays.
        module: with one generator function, ``program``.
        called: functions of the controller that it calls.
    """

    name: str
    secondary: bool
    module: ast.Module
    called: frozenset[str]


def translated(text: str, table: Mapping[str, Builtin]) -> Translation:
    """A program's text in Python; functions of the controller are those of a table.

    Raises:
        ScriptFaultError: it is no program, or calls what nobody knows; says where.
    """
    return _Translator(lexer.tokens(text), table).program()


class _Translator:
    def __init__(self, found: list[Token], table: Mapping[str, Builtin]) -> None:
        self._tokens, self._table = found, table
        self._at = self._depth = 0
        self._own = {
            name.text for key, name in pairwise(found) if key.kind in ("def", "sec", "thread")
        }
        self._called: set[str] = set()
        self._top = self._scope = _Scope(None)
        self._functions: list[tuple[_Scope, ast.FunctionDef]] = []

    def program(self) -> Translation:
        """The whole text; one function is that function's program."""
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
        program = self._generator(start, "program", [], body)
        shared = self._top.plain | self._top.local | {
            name for scope, _ in self._functions for name in scope.shared
        } | self._top.shared  # fmt: skip
        self._declare(program, start, shared, set())
        for scope, function in self._functions:
            self._resolve(scope, function, shared)
        return Translation(name, secondary, ast.Module([program], []), frozenset(self._called))

    def _is_whole(self) -> bool:
        """Whether the text is one function without parameters, from its first token to its end."""
        kinds = [token.kind for token in self._tokens]
        self._skip_lines()
        marks = [token.text for token in self._tokens[self._at + 2 : self._at + 4]]
        if self._next().kind not in ("def", "sec") or marks != ["(", ")"]:
            return False
        opens = ("def", "sec", "thread", "if", "while")
        depth = 0
        for k in range(self._at, len(kinds)):
            depth += (kinds[k] in opens) - (kinds[k] == "end")
            if depth == 0:
                return all(kind in (lexer.LINE, lexer.END) for kind in kinds[k + 1 :])
        return True

    def _resolve(self, scope: _Scope, function: ast.FunctionDef, shared: set[str]) -> None:
        """Say whose the variables are to which a function assigns."""
        enclosing, around = set[str](), scope.around
        while around is not None and around is not self._top:
            enclosing |= around.bound - around.shared
            around = around.around
        free = scope.plain - scope.parameters - scope.local - scope.shared
        start = self._tokens[0]
        self._declare(function, start, scope.shared | (free & shared - enclosing), free & enclosing)

    @staticmethod
    def _declare(
        function: ast.FunctionDef, place: Token, shared: set[str], enclosing: set[str]
    ) -> None:
        for kind, names in ((ast.Global, shared), (ast.Nonlocal, enclosing)):
            if names:
                statement = kind([f"v_{name}" for name in sorted(names)])
                function.body.insert(0, _located(place, statement))

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
        """The next token, taken, if it is one of these marks or keywords."""
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
        """Statements up to an end; functions are known from the start.

        A statement ends where it is complete: a line's end may follow, and need not.
        """
        self._deeper()
        functions: list[ast.stmt] = []
        rest: list[ast.stmt] = []
        while True:
            while self._next().kind == lexer.LINE or self._next().text == ";":
                self._at += 1
            if self._next().kind in ends:
                self._depth -= 1
                return functions + rest
            statement = self._statement()
            if isinstance(statement, ast.FunctionDef):
                functions.append(statement)
            elif statement is not None:
                rest.append(statement)

    def _body(self, *ends: str) -> list[ast.stmt]:
        place = self._take(":")
        return self._block(*ends) or [_located(place, ast.Pass())]

    def _statement(self) -> ast.stmt | None:
        token = self._next()
        if token.kind in ("def", "sec", "thread"):
            return self._function()
        if token.kind in ("if", "while", "return", "break", "continue", "halt", "kill", "join"):
            self._at += 1
            make = {"if": self._if, "while": self._while, "return": self._return}.get(token.kind)
            return self._leave(token) if make is None else make(token)
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
        return _located(token, ast.Expr(target))

    def _assign(self, token: Token, scope: str, target: ast.expr) -> ast.stmt:
        value = self._expression()
        if isinstance(target, ast.Name):
            name = target.id[2:]
            names = {"global": self._scope.shared, "local": self._scope.local}
            names.get(scope, self._scope.plain).add(name)
            target.ctx = ast.Store()
            return _located(token, ast.Assign([target], _own_value(token, value)))
        if isinstance(target, ast.Call) and getattr(target.func, "id", "") == "get":
            put = _call(token, "put", _own_value(token, value), *target.args)
            return _located(token, ast.Expr(put))
        raise self._wrong(token)

    def _leave(self, token: Token) -> ast.stmt:
        if token.kind == "halt":
            return _located(token, ast.Raise(_name(token, "ProgramEndsError"), None))
        if token.kind == "kill":
            return _located(token, ast.Expr(_call(token, "kill", self._expression())))
        if token.kind == "join":
            waited = _waited(token, _call(token, "join", self._expression()))
            return _located(token, ast.Expr(waited))
        return _located(token, ast.Break() if token.kind == "break" else ast.Continue())

    def _return(self, token: Token) -> ast.stmt:
        bare = self._next().kind in (lexer.LINE, "end")
        value = None if bare else self._expression()
        return _located(token, ast.Return(value))

    def _while(self, token: Token) -> ast.stmt:
        test = _truth(token, self._expression())
        body = [_located(token, ast.Expr(_call(token, "spend"))), *self._body("end")]
        self._take("end")
        return _located(token, ast.While(test, body, []))

    def _if(self, token: Token) -> ast.stmt:
        ends = ("elif", "else", "end")
        test = _truth(token, self._expression())
        body = self._body(*ends)
        otherwise: list[ast.stmt] = []
        if following := self._seen("elif"):
            otherwise = [self._if(following)]
        elif self._seen("else"):
            otherwise = self._body("end")
            self._take("end")
        else:
            self._take("end")
        return _located(token, ast.If(test, body, otherwise))

    def _function(self) -> ast.stmt:
        start = self._take("def", "sec", "thread")
        name = self._take(lexer.NAME)
        scope = self._scope = _Scope(self._scope)
        defaults: list[ast.expr] = []
        names: list[str] = []
        self._take("(")
        while not self._seen(")"):
            names.append(self._take(lexer.NAME).text)
            if self._seen("="):
                defaults.append(self._expression())
            elif defaults:
                raise self._wrong(self._next())
            if self._next().text != ")":
                self._take(",")
        scope.parameters.update(names)
        body = self._body("end")
        self._take("end")
        assert scope.around is not None
        self._scope = scope.around
        function = self._generator(start, f"f_{name.text}", names, body)
        function.args.defaults = defaults
        self._functions.append((scope, function))
        return function

    @staticmethod
    def _generator(
        place: Token, name: str, parameters: list[str], body: list[ast.stmt]
    ) -> ast.FunctionDef:
        """A generator function; what it is given becomes its own."""
        never = ast.If(
            _located(place, ast.Constant(False)),
            [_located(place, ast.Expr(_located(place, ast.Yield(None))))], [],
        )  # fmt: skip
        first: list[ast.stmt] = [
            _located(place, never), _located(place, ast.Expr(_call(place, "spend"))),
        ]  # fmt: skip
        for parameter in parameters:
            target = _name(place, f"v_{parameter}", ast.Store())
            copy = _call(place, "copied", _name(place, f"v_{parameter}"))
            first.append(_located(place, ast.Assign([target], copy)))
        arguments = ast.arguments(
            posonlyargs=[], kwonlyargs=[], kw_defaults=[], defaults=[],
            args=[_located(place, ast.arg(f"v_{parameter}")) for parameter in parameters],
        )  # fmt: skip
        function = ast.FunctionDef(name, arguments, first + body, [])
        return _located(place, function)

    # ---- expressions -------------------------------------------------------------------------

    def _expression(self) -> ast.expr:
        self._deeper()
        found = self._level(0)
        self._depth -= 1
        return found

    def _level(self, number: int) -> ast.expr:
        if number == len(_LEVELS):
            return self._unary()
        left = self._level(number + 1)
        count = 0
        while (sign := self._seen(*_LEVELS[number])) is not None:
            self._skip_lines()
            left = _operation(sign, left, self._level(number + 1))
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
            return _located(sign, ast.UnaryOp(ast.Not(), _truth(sign, operand)))
        return operand if sign.text == "+" else _call(sign, "o_negative", operand)

    def _postfix(self, target: ast.expr) -> ast.expr:
        while True:
            if token := self._seen("["):
                target = _call(token, "get", target, self._expression())
                self._take("]")
            elif token := self._seen("."):
                member = self._take(lexer.NAME)
                target = _call(token, "get", target, _constant(member, member.text))
            else:
                return target

    def _atom(self) -> ast.expr:
        token = self._next()
        kind = token.kind
        self._at += kind != lexer.END
        if kind in (lexer.NUMBER, lexer.TEXT, "True", "False"):
            return _constant(token, _literal(token))
        if kind == lexer.NAME:
            return self._call(token) if self._seen("(") else _name(token, f"v_{token.text}")
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
                return _call(token, "get", _name(token, "v_p"), items[0])
            if len(items) != 6:
                raise ScriptFaultError("a pose has six elements", token.line, token.column)
            return _call(token, "Pose", _located(token, ast.List(items, ast.Load())))
        if token.text == "(" and kind == lexer.MARK:
            inner = self._expression()
            self._take(")")
            return inner
        raise self._wrong(token)

    def _items(self) -> list[ast.expr]:
        items = []
        while not self._seen("]"):
            place = self._next()
            items.append(_own_value(place, self._expression()))
            if self._next().text != "]":
                self._take(",")
        return items

    def _arguments(self) -> tuple[list[ast.expr], list[tuple[Token, ast.expr]]]:
        """Arguments of a call by place, and by name."""
        places: list[ast.expr] = []
        names: list[tuple[Token, ast.expr]] = []
        while not self._seen(")"):
            following = self._tokens[self._at + 1] if self._next().kind == lexer.NAME else None
            if following is not None and following.text == "=" and following.kind == lexer.MARK:
                keyword = self._take(lexer.NAME)
                self._at += 1
                names.append((keyword, self._expression()))
            elif names:
                raise self._wrong(self._next())
            else:
                places.append(self._expression())
            if self._next().text != ")":
                self._take(",")
        return places, names

    def _own_call(self, name: Token) -> ast.Call:
        places, names = self._arguments()
        call = _call(name, f"f_{name.text}", *places)
        call.keywords = [_located(key, ast.keyword(f"v_{key.text}", v)) for key, v in names]
        return call

    def _call(self, name: Token) -> ast.expr:
        if name.text in self._own:
            return _waited(name, self._own_call(name))
        builtin = self._table.get(name.text)
        if builtin is None:
            raise ScriptFaultError(NO_NAME.format(name.text), name.line, name.column)
        places, names = self._arguments()
        try:
            builtin.signature.bind(None, *places, **{key.text: v for key, v in names})
        except TypeError as error:
            raise ScriptFaultError(f"{name.text}: {error}", name.line, name.column) from None

        def checked(parameter: str, value: ast.expr) -> ast.expr:
            kind = builtin.kinds.get(parameter)
            words = _constant(name, f"{name.text}: {parameter}")
            return value if kind is None else _call(name, f"as_{kind}", value, words)

        self._called.add(name.text)
        parameters = list(builtin.signature.parameters)[1:]
        given = [checked(parameters[k], value) for k, value in enumerate(places)]
        call = _call(name, f"b_{name.text}", _name(name, "context"), *given)
        call.keywords = [_located(key, ast.keyword(key.text, checked(key.text, v)))
                         for key, v in names]  # fmt: skip
        return _waited(name, call) if builtin.waits else call


def _located(place: Token, node: T) -> T:
    """The node at the place of a token."""
    column = place.column - 1
    more = {"lineno": place.line, "end_lineno": place.line}
    for key, value in (more | {"col_offset": column, "end_col_offset": column + 1}).items():
        setattr(node, key, value)
    return node


def _name(place: Token, name: str, ctx: ast.expr_context | None = None) -> ast.Name:
    return _located(place, ast.Name(name, ctx or ast.Load()))


def _constant(place: Token, value: float | int | bool | str) -> ast.Constant:
    return _located(place, ast.Constant(value))


def _call(place: Token, name: str, *arguments: ast.expr) -> ast.Call:
    return _located(place, ast.Call(_name(place, name), list(arguments), []))


def _waited(place: Token, call: ast.expr) -> ast.expr:
    return _located(place, ast.YieldFrom(call))


def _truth(place: Token, test: ast.expr) -> ast.expr:
    """A condition, checked to be one."""
    sure = isinstance(test, ast.Compare | ast.BoolOp | ast.UnaryOp)
    return test if sure else _call(place, "truth", test)


def _own_value(place: Token, value: ast.expr) -> ast.expr:
    """A value that nobody else has: lists and structs are copied."""
    return value if isinstance(value, _FRESH) else _call(place, "copied", value)


def _operation(sign: Token, left: ast.expr, right: ast.expr) -> ast.expr:
    if sign.text in ("and", "or"):
        act: ast.boolop = ast.And() if sign.text == "and" else ast.Or()
        return _located(sign, ast.BoolOp(act, [_truth(sign, left), _truth(sign, right)]))
    if sign.text in ("==", "!=", "<>"):
        equal: ast.cmpop = ast.Eq() if sign.text == "==" else ast.NotEq()
        return _located(sign, ast.Compare(left, [equal], [right]))
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
