"""The mutants of one source text: each is one small change of it, made in place so that lines stay where they are.

Left alone: annotations, decorators, docstrings, what is logged, the texts of messages, `__slots__`.
"""

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

_COMPARISONS: dict[type[ast.cmpop], tuple[str, tuple[str, ...]]] = {
    ast.Lt: ("<", ("<=", ">=")),
    ast.LtE: ("<=", ("<", ">")),
    ast.Gt: (">", (">=", "<=")),
    ast.GtE: (">=", (">", "<")),
    ast.Eq: ("==", ("!=",)),
    ast.NotEq: ("!=", ("==",)),
    ast.Is: ("is", ("is not",)),
    ast.IsNot: (r"is\s+not", ("is",)),
    ast.In: ("in", ("not in",)),
    ast.NotIn: (r"not\s+in", ("in",)),
}
_OPERATORS: dict[type[ast.operator], tuple[str, str]] = {
    ast.Add: (r"\+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: (r"\*", "/"),
    ast.Div: ("/", "*"),
    ast.FloorDiv: ("//", "/"),
    ast.Mod: ("%", "*"),
    ast.Pow: (r"\*\*", "*"),
    ast.BitAnd: ("&", "|"),
    ast.BitOr: (r"\|", "&"),
    ast.BitXor: (r"\^", "|"),
    ast.LShift: ("<<", ">>"),
    ast.RShift: (">>", "<<"),
}
_CALLS = {
    "min": "max",
    "max": "min",
    "any": "all",
    "all": "any",
    "floor": "ceil",
    "ceil": "floor",
    "sin": "cos",
    "cos": "sin",
    "tan": "atan",
    "atan": "tan",
    "abs": "",
}
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


@dataclass(frozen=True, slots=True, kw_only=True)
class Mutant:
    """One change: the bytes from `start` to `end` of the source become `text`."""

    module: str
    function: str
    """Qualified name of the outermost function whose body has the change; empty outside of functions."""
    line: int
    source: bytes
    start: int
    end: int
    text: bytes

    @property
    def changed(self) -> bytes:
        """The whole source with the change."""
        return self.source[: self.start] + self.text + self.source[self.end :]

    @property
    def lines(self) -> tuple[list[str], list[str]]:
        """The whole lines that the change touches, before and after it."""
        begin = self.source.rfind(b"\n", 0, self.start) + 1
        finish = self.source.find(b"\n", self.end)
        finish = len(self.source) if finish < 0 else finish
        after = self.source[begin : self.start] + self.text + self.source[self.end : finish]
        return self.source[begin:finish].decode().split("\n"), after.decode().split("\n")

    @property
    def diff(self) -> str:
        """What changed where, for people."""
        before, after = self.lines
        head = f"{self.module}:{self.line} {self.function}".rstrip()
        return "\n".join([head, *(f"-{line}" for line in before), *(f"+{line}" for line in after)])

    @property
    def key(self) -> tuple[str, str, str, str]:
        """Tells it from the others, also when lines above it have come or gone."""
        before, after = (" ".join(line.strip() for line in side) for side in self.lines)
        return self.module, self.function, before, after


def mutants(module: str, source: bytes) -> list[Mutant]:
    """All mutants of a source that can be compiled, in the order of the lines."""
    finder = _Finder(module, source)
    finder.visit(ast.parse(source))
    unique = {(mutant.start, mutant.end, mutant.text): mutant for mutant in finder.found}
    return sorted((m for m in unique.values() if _compiles(m.changed)), key=lambda m: (m.start, m.end, m.text))


def _compiles(source: bytes) -> bool:
    try:
        compile(source, "mutant", "exec", dont_inherit=True)
    except SyntaxError:
        return False
    return True


class _Finder(ast.NodeVisitor):
    def __init__(self, module: str, source: bytes) -> None:
        self.found: list[Mutant] = []
        self._module, self._source = module, source
        self._line_starts = [0, *(match.end() for match in re.finditer(b"\n", source))]
        self._scope: list[str] = []
        self._function = ""

    def _start(self, node: ast.expr | ast.stmt) -> int:
        return self._line_starts[node.lineno - 1] + node.col_offset

    def _end(self, node: ast.expr | ast.stmt) -> int:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return self._line_starts[node.end_lineno - 1] + node.end_col_offset

    def _add(self, start: int, end: int, text: str) -> None:
        line = self._source.count(b"\n", 0, start) + 1
        self.found.append(
            Mutant(
                module=self._module,
                function=self._function,
                line=line,
                source=self._source,
                start=start,
                end=end,
                text=text.encode(),
            )
        )

    def _replace(self, node: ast.expr | ast.stmt, text: str) -> None:
        self._add(self._start(node), self._end(node), text)

    def _between(self, left: int, right: int, pattern: str, text: str) -> None:
        """Replace an operator that stands between two operands."""
        match = re.search(pattern.encode(), self._source[left:right])
        if match is not None:
            self._add(left + match.start(), left + match.end(), text)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        self._scope.append(node.name)
        for statement in node.body:
            self.visit(statement)
        self._scope.pop()

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        self._visit_function(node)

    def visit_AsyncFunctionDef(self, node: ast.AsyncFunctionDef) -> None:
        self._visit_function(node)

    def _visit_function(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        for default in (*node.args.defaults, *node.args.kw_defaults):
            if default is not None:
                self.visit(default)
        outer, self._function = self._function, self._function or ".".join([*self._scope, node.name])
        for statement in node.body:
            self.visit(statement)
        self._function = outer

    def visit_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant) or _logs(node.value):
            return
        self._replace(node, "pass")
        self.generic_visit(node)

    def visit_Assign(self, node: ast.Assign) -> None:
        if any(isinstance(target, ast.Name) and target.id == "__slots__" for target in node.targets):
            return
        if self._function and any(isinstance(target, ast.Attribute | ast.Subscript) for target in node.targets):
            self._replace(node, "pass")
        if not self._function and isinstance(node.value, ast.Tuple | ast.Set):
            self._shorten(node.value.elts)
        self.visit(node.value)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is None:
            return
        if self._function and isinstance(node.target, ast.Attribute | ast.Subscript):
            self._replace(node, "pass")
        self.visit(node.value)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self._replace(node, "pass")
        operator, other = _OPERATORS[type(node.op)]
        self._between(self._end(node.target), self._start(node.value), operator, other)
        self.visit(node.value)

    def visit_Raise(self, node: ast.Raise) -> None:
        self._replace(node, "pass")

    def visit_Delete(self, node: ast.Delete) -> None:
        self._replace(node, "pass")

    def visit_Return(self, node: ast.Return) -> None:
        if node.value is not None and not isinstance(node.value, ast.Constant):
            self._replace(node, "return None")
        self.generic_visit(node)

    def visit_If(self, node: ast.If) -> None:
        self._decide(node.test)
        self.generic_visit(node)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        self._decide(node.test)
        self.generic_visit(node)

    def visit_While(self, node: ast.While) -> None:
        self._replace(node.test, "False")
        self.generic_visit(node)

    def visit_comprehension(self, node: ast.comprehension) -> None:
        for condition in node.ifs:
            self._replace(condition, "True")
        self.generic_visit(node)

    def _decide(self, test: ast.expr) -> None:
        self._replace(test, "True")
        self._replace(test, "False")

    def visit_Compare(self, node: ast.Compare) -> None:
        for (left, right), operator in zip(pairwise([node.left, *node.comparators]), node.ops, strict=True):
            pattern, others = _COMPARISONS[type(operator)]
            for other in others:
                self._between(self._end(left), self._start(right), pattern, other)
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        if type(node.op) in _OPERATORS:
            operator, other = _OPERATORS[type(node.op)]
            self._between(self._end(node.left), self._start(node.right), operator, other)
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        word, other = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        for left, right in pairwise(node.values):
            self._between(self._end(left), self._start(right), rf"\b{word}\b", other)
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        pattern, other = {ast.Not: ("not", ""), ast.USub: ("-", "+"), ast.Invert: ("~", ""), ast.UAdd: (r"\+", "-")}[
            type(node.op)
        ]
        self._between(self._start(node), self._start(node.operand), pattern, other)
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        value = node.value
        if isinstance(value, bool):
            self._replace(node, str(not value))
        elif isinstance(value, int):
            self._replace(node, str(value + 1))
        elif isinstance(value, float):
            self._replace(node, repr(1.5 * value if value else 1.0))

    def visit_Call(self, node: ast.Call) -> None:
        name = node.func
        if isinstance(name, ast.Name) and name.id in _CALLS:
            self._replace(name, _CALLS[name.id])
        elif isinstance(name, ast.Attribute) and _CALLS.get(name.attr):
            self._add(self._end(name) - len(name.attr), self._end(name), _CALLS[name.attr])
        self.generic_visit(node)

    def visit_Dict(self, node: ast.Dict) -> None:
        for key, value in zip(node.keys, node.values, strict=True):
            start = self._start(key) if key is not None else self._source.rfind(b"**", 0, self._start(value))
            self._drop(start, self._end(value))
        self.generic_visit(node)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """A message: its places are not known before Python 3.12, and its words are for people."""

    def _shorten(self, elements: list[ast.expr]) -> None:
        for element in elements if len(elements) > 1 else ():
            self._drop(self._start(element), self._end(element))

    def _drop(self, start: int, end: int) -> None:
        """Without one entry, and without the comma after it."""
        comma = re.match(rb"\s*,", self._source[end:])
        self._add(start, end + comma.end() if comma else end, "")


def _logs(node: ast.expr) -> bool:
    function = node.func if isinstance(node, ast.Call) else None
    return isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name) and function.value.id == "log"


def functions(module: object, path: str) -> Iterator[object]:
    """All functions of a loaded module that were written in it, also those that a decorator hides."""
    for holder in (module, *(value for value in vars(module).values() if isinstance(value, type))):
        for value in vars(holder).values():
            for bare in (value, getattr(value, "fget", None), getattr(value, "__func__", None)):
                inner = getattr(bare, "__wrapped__", bare)
                if getattr(getattr(inner, "__code__", None), "co_filename", None) == path:
                    yield inner
