"""Tokens to a tree, by recursive descent with a bounded depth."""

from robot_emulators.ur.urscript import tokens as lexer
from robot_emulators.ur.urscript.faults import ScriptFaultError
from robot_emulators.ur.urscript.syntax import (
    Assign,
    Binary,
    Block,
    Call,
    Evaluate,
    Expression,
    Function,
    If,
    Index,
    Leave,
    ListOf,
    Literal,
    Member,
    Name,
    Return,
    Run,
    Statement,
    ThreadEnd,
    Unary,
    While,
)
from robot_emulators.ur.urscript.tokens import Token

_DEEPEST = 60
"""Nested blocks and brackets; deeper than any program that a person wrote."""
_LEVELS = (
    ("or", "xor"),
    ("and",),
    ("==", "!=", "<>", "<", ">", "<=", ">="),
    ("+", "-"),
    ("*", "/", "%"),
    ("^",),
)
_SILENT = ("pass", "enter_critical", "exit_critical")
"""Threads change only where one of them waits: critical sections need nothing."""


def parse(text: str) -> Block:
    """The statements of a program.

    Raises:
        ScriptFaultError: it is none; says where.
    """
    return _Parser(lexer.tokens(text)).program()


class _Parser:
    def __init__(self, found: list[Token]) -> None:
        self._tokens, self._at, self._depth = found, 0, 0

    def program(self) -> Block:
        found = self._block(lexer.END)
        self._take(lexer.END)
        return found

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

    def _deeper(self) -> None:
        self._depth += 1
        if self._depth > _DEEPEST:
            token = self._next()
            raise ScriptFaultError("nested too deeply", token.line, token.column)

    def _block(self, *ends: str) -> Block:
        self._deeper()
        found: list[Statement] = []
        while True:
            while self._next().kind == lexer.LINE or self._next().text == ";":
                self._at += 1
            if self._next().kind in ends:
                self._depth -= 1
                return tuple(found)
            statement = self._statement()
            if statement is not None:
                found.append(statement)
            if self._next().kind not in ends and self._next().text != ";":
                self._take(lexer.LINE)

    def _statement(self) -> Statement | None:
        token = self._next()
        kind = token.kind
        if kind in ("def", "sec", "thread"):
            return self._function()
        if kind == "if":
            return self._if()
        if kind == "while":
            self._at += 1
            condition, body = self._expression(), self._body("end")
            self._take("end")
            return While(token.line, token.column, condition, body)
        if kind in _SILENT:
            self._at += 1
            return None
        return self._simple(token)

    def _simple(self, token: Token) -> Statement:
        line, column, kind = token.line, token.column, token.kind
        if kind == "return":
            self._at += 1
            bare = self._next().kind in (lexer.LINE, "end")
            return Return(line, column, None if bare else self._expression())
        if kind in ("break", "continue", "halt"):
            self._at += 1
            return Leave(line, column, kind)
        if kind in ("kill", "join"):
            self._at += 1
            return ThreadEnd(line, column, kind, self._expression())
        scope = self._seen("global", "local")
        target = self._expression()
        if self._seen("="):
            if not isinstance(target, Name | Index | Member):
                raise self._wrong(token)
            return Assign(line, column, scope.text if scope else "", target, self._expression())
        if scope is not None:
            raise self._wrong(self._next())
        return Evaluate(line, column, target)

    def _body(self, *ends: str) -> Block:
        self._take(":")
        return self._block(*ends)

    def _function(self) -> Function:
        start = self._take("def", "sec", "thread")
        name = self._take(lexer.NAME)
        parameters: list[tuple[str, Expression | None]] = []
        self._take("(")
        while not self._seen(")"):
            parameter = self._take(lexer.NAME).text
            parameters.append((parameter, self._expression() if self._seen("=") else None))
            if self._next().text != ")":
                self._take(",")
        body = self._body("end")
        self._take("end")
        return Function(start.line, start.column, start.text, name.text, tuple(parameters), body)

    def _if(self) -> If:
        start = self._take("if")
        ends = ("elif", "else", "end")
        branches = [(self._expression(), self._body(*ends))]
        otherwise: Block = ()
        while not self._seen("end"):
            if self._seen("elif"):
                branches.append((self._expression(), self._body(*ends)))
            else:
                self._take("else")
                otherwise = self._body("end")
        return If(start.line, start.column, tuple(branches), otherwise)

    def _expression(self) -> Expression:
        self._deeper()
        found = self._level(0)
        self._depth -= 1
        return found

    def _level(self, number: int) -> Expression:
        if number == len(_LEVELS):
            return self._unary()
        left = self._level(number + 1)
        while (operator := self._seen(*_LEVELS[number])) is not None:
            while self._next().kind == lexer.LINE:
                self._at += 1
            right = self._level(number + 1)
            left = Binary(operator.line, operator.column, operator.text, left, right)
        return left

    def _unary(self) -> Expression:
        operator = self._seen("not", "-", "+")
        if operator is None:
            return self._postfix(self._atom())
        self._deeper()
        deep = self._level(2) if operator.text == "not" else self._unary()
        self._depth -= 1
        return Unary(operator.line, operator.column, operator.text, deep)

    def _postfix(self, target: Expression) -> Expression:
        while True:
            if token := self._seen("["):
                target = Index(token.line, token.column, target, self._expression())
                self._take("]")
            elif token := self._seen("."):
                target = Member(token.line, token.column, target, self._take(lexer.NAME).text)
            else:
                return target

    def _atom(self) -> Expression:
        token = self._next()
        line, column, kind = token.line, token.column, token.kind
        self._at += kind != lexer.END
        if kind == lexer.NUMBER:
            return Literal(line, column, _number(token))
        if kind == lexer.TEXT:
            return Literal(line, column, token.text[1:-1])
        if kind in ("True", "False"):
            return Literal(line, column, kind == "True")
        if kind == lexer.NAME:
            return self._call(token) if self._seen("(") else Name(line, column, token.text)
        if kind == "run":
            name = self._take(lexer.NAME)
            self._take("(")
            return Run(line, column, self._call(name))
        if kind == lexer.POSE or (token.text == "[" and kind == lexer.MARK):
            return ListOf(line, column, self._items("]"), kind == lexer.POSE)
        if token.text == "(" and kind == lexer.MARK:
            inner = self._expression()
            self._take(")")
            return inner
        raise self._wrong(token)

    def _items(self, end: str) -> tuple[Expression, ...]:
        found = []
        while not self._seen(end):
            found.append(self._expression())
            if self._next().text != end:
                self._take(",")
        return tuple(found)

    def _call(self, name: Token) -> Call:
        places: list[Expression] = []
        names: list[tuple[str, Expression]] = []
        while not self._seen(")"):
            following = self._tokens[self._at + 1] if self._next().kind == lexer.NAME else None
            if following is not None and following.text == "=" and following.kind == lexer.MARK:
                keyword = self._take(lexer.NAME).text
                self._at += 1
                names.append((keyword, self._expression()))
            elif names:
                raise self._wrong(self._next())
            else:
                places.append(self._expression())
            if self._next().text != ")":
                self._take(",")
        return Call(name.line, name.column, name.text, tuple(places), tuple(names))


def _number(token: Token) -> float | int:
    word = token.text
    if word[:2] in ("0x", "0X"):
        value: float | int = int(word, 16)
    else:
        value = int(word) if word.isdigit() and len(word) < 16 else float(word)
    if value > 1e300:
        raise ScriptFaultError("a number is too large", token.line, token.column)
    return value
