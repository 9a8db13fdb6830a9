"""Grammar, positions, syntax errors and the printer."""

from __future__ import annotations

from pathlib import Path

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.st import ast, parser
from iec61499.st.parser import TreeBuilder, lark_parser, parse_algorithm, parse_expression
from iec61499.st.printer import print_algorithm, print_expression


def test_every_grammar_rule_has_a_handler() -> None:
    passed_through = {"expression", "xor_expression", "and_expression", "equality", "comparison", "sum", "product"}
    passed_through |= {"power", "unary_expression", "primary", "literal", "label", "statement", "initial"}
    for rule in lark_parser().rules:
        name = str(rule.alias or rule.origin.name)
        if name.startswith("_") or (rule.alias is None and name in passed_through):
            continue
        assert callable(getattr(TreeBuilder, name, None)), f"no handler for {name}"


@pytest.mark.parametrize(
    ("text", "grouped"),
    [
        ("a OR b XOR c AND d", "(a OR (b XOR (c AND d)))"),
        ("a AND b = c", "(a AND (b = c))"),
        ("a & b OR c", "((a AND b) OR c)"),
        ("a = b < c", "(a = (b < c))"),
        ("a < b + c", "(a < (b + c))"),
        ("a + b * c", "(a + (b * c))"),
        ("a * b ** c", "(a * (b ** c))"),
        ("a MOD b / c", "((a MOD b) / c)"),
        ("-a ** b", "((-a) ** b)"),
        ("a ** -b", "(a ** (-b))"),
        ("a ** b ** c", "((a ** b) ** c)"),
        ("a - b - c", "((a - b) - c)"),
        ("a - (b - c)", "(a - (b - c))"),
        ("NOT a AND b", "((NOT a) AND b)"),
        ("NOT a = b", "((NOT a) = b)"),
        ("a - -b", "(a - (-b))"),
    ],
)
def test_precedence_is_that_of_the_standard(text: str, grouped: str) -> None:
    tree = parse_expression(text)
    assert tree == parse_expression(grouped)
    assert _grouped(tree) == grouped


def _grouped(node: ast.Expression) -> str:
    match node:
        case ast.Binary(operator=operator, left=left, right=right):
            return f"({_grouped(left)} {operator} {_grouped(right)})"
        case ast.Unary(operator=operator, operand=operand):
            return f"({operator}{' ' * (operator == 'NOT')}{_grouped(operand)})"
    return print_expression(node)


def test_printed_expressions_have_only_the_needed_parentheses() -> None:
    text = "a - (b - c) * d ** (e ** f) OR NOT (g AND h) AND (i OR j)"
    assert print_expression(parse_expression(text)) == text


@pytest.mark.parametrize("text", ["if A then ; end_if;", "IF a THEN ; END_IF;", "If a Then ; End_If;"])
def test_keywords_have_no_case(text: str) -> None:
    assert isinstance(parse_algorithm(text).body[0], ast.If)


@pytest.mark.parametrize("name", ["ANDROID", "ORDER", "IFX", "END_IFS", "NOTE", "TRUEISH", "MODE", "T", "E_1", "_x"])
def test_names_may_begin_with_keywords(name: str) -> None:
    assert parse_expression(name) == ast.VariableAccess(ast.Position(), name)


def test_comments_are_ignored() -> None:
    text = "x (* one\n ** *) := // two\n 1 /* three */;"
    assert parse_algorithm(text) == parse_algorithm("x := 1;")


@pytest.mark.parametrize(
    ("text", "value", "type_name"),
    [
        ("12", 12, ""),
        ("1_000", 1000, ""),
        ("16#fF", 255, ""),
        ("2#1010_1010", 170, ""),
        ("8#17", 15, ""),
        ("1.5", 1.5, ""),
        ("1.0E-3", 0.001, ""),
        ("2e3", 2000.0, ""),
        ("TRUE", True, ""),
        ("false", False, ""),
        ("INT#-5", -5, "INT"),
        ("WORD#16#FF", 255, "WORD"),
        ("LREAL#1", 1.0, "LREAL"),
        ("BOOL#1", True, "BOOL"),
        ("REAL#0.1", 0.10000000149011612, "REAL"),
        ("T#10ms", 10_000_000, "TIME"),
        ("TIME#-1h30m", -5_400_000_000_000, "TIME"),
        ("T#1.5s", 1_500_000_000, "TIME"),
        ("LTIME#1us2ns", 1002, "LTIME"),
        ("'it$'s $$5$L'", "it's $5\n", "STRING"),
        ('"$0041b"', "Ab", "WSTRING"),
        ("STRING#'x'", "x", "STRING"),
        ("''", "", "STRING"),
    ],
)
def test_literals(text: str, value: bool | int | float | str, type_name: str) -> None:
    literal = parse_expression(text)
    assert literal == ast.Literal(ast.Position(), value, type_name)
    assert parse_expression(print_expression(literal)) == literal


def test_positions_count_from_the_start_of_the_text_in_its_file() -> None:
    algorithm = parse_algorithm("x := 1;\n  y := x\n + z;", "f.fbt", 10, 20)
    first, second = algorithm.body
    assert first.at == ast.Position("f.fbt", 10, 20)
    assert second.at == ast.Position("f.fbt", 11, 3)
    assert isinstance(second, ast.Assignment)
    assert isinstance(second.value, ast.Binary)
    assert second.value.at == ast.Position("f.fbt", 12, 2)
    assert second.value.right.at == ast.Position("f.fbt", 12, 4)


def test_algorithm_with_wrapper_and_variables() -> None:
    text = """ALGORITHM REQ
VAR_TEMP
  i, j : DINT := 5;
  m : ARRAY [0..1, -1..1] OF LREAL;
END_VAR
VAR CONSTANT k : ARRAY [1..4] OF INT := [1, 2(-7), 3]; END_VAR
m[0, i] := 1.0;
m[0][i] := 1.0;
END_ALGORITHM
"""
    algorithm = parse_algorithm(text)
    assert algorithm.name == "REQ"
    assert [d.name for d in algorithm.declarations] == ["i", "j", "m", "k"]
    assert [d.constant for d in algorithm.declarations] == [False, False, False, True]
    assert algorithm.body[0] == algorithm.body[1]
    assert parse_algorithm(print_algorithm(algorithm)) == algorithm


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x := ;", "f.fbt:3:10: unexpected ';': expected an expression"),
        ("x := 1", "f.fbt:3:11: unexpected end of text: expected an operator or ;"),
        ("x := 1;\nIF x y := 2;", "f.fbt:4:6: unexpected 'y': expected an operator, (, ., THEN or ["),
        ("x = 1;", "f.fbt:3:7: unexpected '=': expected := to assign"),
        ("x := 'a", 'f.fbt:3:10: unexpected character "\'"'),
        ("x := a $ b;", "f.fbt:3:12: unexpected character '$'"),
        ("x := 2#12;", "f.fbt:3:10: 2#12 has a digit beyond base 2"),
        ("x := SINT#200;", "f.fbt:3:10: SINT#200 is out of the range of SINT: expected -128 to 127"),
        ("x := '$q';", "unknown escape $q"),
        ("x := T#5;", "f.fbt:3:10: 'T#5' is not a TIME: expected a duration such as T#10ms or T#1h30m"),
        ("x := 1.0e999;", "f.fbt:3:10: 1.0e999 is beyond the range of LREAL"),
        ("END_IF;", "f.fbt:3:5: unexpected 'END_IF'"),
        ("IF a THEN x := 1;", "unexpected end of text"),
        ("x := (* open", "comment is not closed: expected *)"),
        ("then := 1;", "f.fbt:3:5: unexpected 'then'"),
    ],
)
def test_syntax_errors_name_position_and_choices(text: str, message: str) -> None:
    with pytest.raises(FunctionBlockError) as caught:
        parse_algorithm(text, "f.fbt", 3, 5)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_parentheses_alone_make_no_deep_tree() -> None:
    assert parse_expression("(" * 5000 + "1" + ")" * 5000) == parse_expression("1")


def test_too_deep_a_tree_is_an_error() -> None:
    with pytest.raises(FunctionBlockError, match="nested"):
        parse_algorithm("x := " + "-" * 5_000 + "1;", "f.fbt")


def test_tables_that_are_kept_damaged_or_nowhere_make_the_same_parser(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tables = tmp_path / "grammar.tables"

    def parsed(kept: Path) -> object:
        monkeypatch.setattr(parser, "TABLES", kept)
        return lark_parser.__wrapped__().parse("x := -a ** 2; IF b THEN y[1] := 2.5; END_IF;", start="algorithm")

    built = parsed(tables)
    whole = tables.read_bytes()
    assert parsed(tables) == built
    for content in (b"", whole[: len(whole) // 2], b"0\n" + whole, whole):
        tables.write_bytes(content)
        assert parsed(tables) == built
        assert tables.read_bytes().splitlines()[0] == whole.splitlines()[0]
    assert parsed(tmp_path / "no folder" / "grammar.tables") == built
