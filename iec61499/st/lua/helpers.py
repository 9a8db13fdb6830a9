"""Lua functions that generated Lua calls; they run on Lua 5.1 to 5.4 and LuaJIT with equal results.

Where numbers are doubles only, integers stay exact because every value is kept below 2^53 and `+ 0` turns a
negative zero into the integer's zero.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

HELPERS: Final[dict[str, tuple[str, tuple[str, ...]]]] = {
    "_floor": ("local _floor = math.floor", ()),
    "_sqrt": ("local _sqrt = math.sqrt", ()),
    "_ln": ("local _ln = math.log", ()),
    "_log": ("local _log = math.log10 or function(x) return math.log(x, 10) end", ()),
    "_exp": ("local _exp = math.exp", ()),
    "_sin": ("local _sin = math.sin", ()),
    "_cos": ("local _cos = math.cos", ()),
    "_tan": ("local _tan = math.tan", ()),
    "_asin": ("local _asin = math.asin", ()),
    "_acos": ("local _acos = math.acos", ()),
    "_atan": ("local _atan = math.atan", ()),
    "_atan2": ("local _atan2 = math.atan2 or math.atan", ()),
    # Lua 5.4 takes x ^ 2 as x * x, and C's pow differs from that in the last bit; so all take it so
    "_pow": (
        "local _cpow = math.pow or function(x, y) return x ^ y end\n"
        "local function _pow(x, y) if y == 2 then return x * x end return _cpow(x, y) end",
        (),
    ),
    "_abs": ("local _abs = math.abs", ()),
    "_min": ("local function _min(a, b) if a < b then return a end return b end", ()),
    "_max": ("local function _max(a, b) if a > b then return a end return b end", ()),
    "_mux": (
        "local function _mux(k, ...)\n"
        'local n = select("#", ...)\n'
        "if k < 0 then k = 0 elseif k >= n then k = n - 1 end\n"
        "return (select(k + 1, ...))\n"
        "end",
        (),
    ),
    "_mul": (
        "local function _mul(a, b)\n"
        "local h = math.floor(b / 65536)\n"
        "return (a * h % 4294967296 * 65536 + a * (b - h * 65536)) % 4294967296\n"
        "end",
        (),
    ),
    "_idiv": (
        "local function _idiv(a, b)\n"
        "if b == 0 then return 0 end\n"
        "local q = a / b\n"
        "if q < 0 then return math.ceil(q) + 0 end\n"
        "return math.floor(q) + 0\n"
        "end",
        (),
    ),
    "_imod": ("local function _imod(a, b) if b == 0 then return 0 end return math.fmod(a, b) + 0 end", ()),
    "_trunc": (
        "local function _trunc(x, low, period)\n"
        "if not (x >= -9223372036854775808.0 and x < 9223372036854775808.0) then return 0 end\n"
        "if x < 0 then x = math.ceil(x) else x = math.floor(x) end\n"
        "x = x % period\n"
        "if x >= period + low then x = x - period end\n"
        "return x\n"
        "end",
        (),
    ),
    "_round": (
        "local function _round(x, low, period)\n"
        "local f = math.floor(x)\n"
        "local d = x - f\n"
        "if d > 0.5 or d == 0.5 and f % 2 == 1 then f = f + 1 end\n"
        "return _trunc(f, low, period)\n"
        "end",
        ("_trunc",),
    ),
    # to the nearest multiple of the last of 24 bits, by adding and taking away 1.5 * 2^29 times the leading bit
    "_f32": (
        "local function _f32(x)\n"
        "local a = math.abs(x)\n"
        "if a == 0 or a ~= a or a == math.huge then return x end\n"
        "if a >= 3.4028235677973366e38 then return x < 0 and -math.huge or math.huge end\n"
        "local p = 2.0 ^ math.floor(math.log(a) * 1.4426950408889634)\n"
        "if p > a then p = p / 2 elseif p * 2 <= a then p = p * 2 end\n"
        "if p < 1.1754943508222875e-38 then p = 1.1754943508222875e-38 end\n"
        "local c = p * 805306368.0\n"
        "local r = (x + c) - c\n"
        "if r == 0 then return x * 0.0 end\n"
        "return r\n"
        "end",
        (),
    ),
    "_bits": (
        "local function _bits(a, b, t)\n"
        "local r, p = 0, 1\n"
        "while a > 0 or b > 0 do\n"
        "local x, y = a % 2, b % 2\n"
        "if t[x + y] then r = r + p end\n"
        "a, b, p = (a - x) / 2, (b - y) / 2, p * 2\n"
        "end\n"
        "return r\n"
        "end",
        (),
    ),
    "_and": ("local _tand = {[2] = true} local function _and(a, b) return _bits(a, b, _tand) end", ("_bits",)),
    "_or": ("local _tor = {true, true} local function _or(a, b) return _bits(a, b, _tor) end", ("_bits",)),
    "_xor": ("local _txor = {true} local function _xor(a, b) return _bits(a, b, _txor) end", ("_bits",)),
    "_shl": ("local function _shl(x, n, w) if n < 0 or n >= w then return 0 end return x * 2 ^ n % 2 ^ w end", ()),
    "_shr": (
        "local function _shr(x, n, w) if n < 0 or n >= w then return 0 end return math.floor(x / 2 ^ n) end",
        (),
    ),
    "_rol": (
        "local function _rol(x, n, w)\n"
        "if n < 0 then return 0 end\n"
        "n = n % w\n"
        "return x * 2 ^ n % 2 ^ w + math.floor(x / 2 ^ (w - n))\n"
        "end",
        (),
    ),
    "_ror": ("local function _ror(x, n, w) if n < 0 then return 0 end return _rol(x, -n % w, w) end", ("_rol",)),
    "_index": (
        "local function _index(i, low, high, where)\n"
        "if i < low or i > high then\n"
        'error(where .. ": index " .. i .. ": expected " .. low .. " to " .. high, 0)\n'
        "end\n"
        "return i - low + 1\n"
        "end",
        (),
    ),
    "_copy": (
        "local function _copy(t)\n"
        "local r = {}\n"
        'for i = 1, #t do if type(t[i]) == "table" then r[i] = _copy(t[i]) else r[i] = t[i] end end\n'
        "return r\n"
        "end",
        (),
    ),
    "_endless": ('local function _endless(where) error(where .. ": loop does not end", 0) end', ()),
    "_left": ("local function _left(s, n) if n < 0 then return s end return string.sub(s, 1, n) end", ()),
    "_right": (
        "local function _right(s, n) if n < 0 or n > #s then return s end return string.sub(s, #s - n + 1) end",
        (),
    ),
    "_mid": (
        "local function _mid(s, n, p) if n < 0 or p < 1 then return s end return string.sub(s, p, p + n - 1) end",
        (),
    ),
    "_insert": (
        "local function _insert(s, t, p)\n"
        "if p < 0 or p > #s then return s end\n"
        "return string.sub(s, 1, p) .. t .. string.sub(s, p + 1)\n"
        "end",
        (),
    ),
    "_replace": (
        "local function _replace(s, t, n, p)\n"
        "if n < 0 or p < 1 or p - 1 + n > #s then return s end\n"
        "return string.sub(s, 1, p - 1) .. t .. string.sub(s, p + n)\n"
        "end",
        (),
    ),
    "_delete": ('local function _delete(s, n, p) return _replace(s, "", n, p) end', ("_replace",)),
    "_character": (
        "local function _character(s, i, where)\n"
        "if i < 1 or i > #s then\n"
        'error(where .. ": character " .. i .. ": expected 1 to " .. #s, 0)\n'
        "end\n"
        "return string.sub(s, i, i)\n"
        "end",
        (),
    ),
    "_with_character": (
        "local function _with_character(s, i, c, where)\n"
        "_character(s, i, where)\n"
        "return string.sub(s, 1, i - 1) .. c .. string.sub(s, i + 1)\n"
        "end",
        ("_character",),
    ),
    "_find": ("local function _find(s, t) return (string.find(s, t, 1, true)) or 0 end", ()),
    "_format": (
        "local function _format(x, f)\n"
        'if x ~= x then return "nan" end\n'
        'if x == math.huge then return "inf" elseif x == -math.huge then return "-inf" end\n'
        "return string.format(f, x)\n"
        "end",
        (),
    ),
    "_string_to_int": (
        "local function _string_to_int(s, low, period, name)\n"
        'if string.find(s, "#", 1, true) and not string.find(s, "^%d") then\n'
        'local prefix, rest = string.match(s, "^([^#]*)#(.*)$")\n'
        "if prefix ~= name then return 0 end\n"
        "s = rest\n"
        "end\n"
        'local base, rest = string.match(s, "^(..?)#(.*)$")\n'
        'base = ({["2"] = 2, ["8"] = 8, ["10"] = 10, ["16"] = 16})[base or "10"]\n'
        "if not base then return 0 end\n"
        'local sign, digits = string.match(rest or s, "^%s*([+-]?)(%w*)")\n'
        'if sign ~= "" and (low == 0 or base ~= 10) then return 0 end\n'
        "local x = 0\n"
        'for c in string.gmatch(digits, ".") do\n'
        "local d = tonumber(c, 36)\n"
        "if d >= base then break end\n"
        "x = x * base + d\n"
        "if x >= period then return 0 end\n"
        "end\n"
        'if sign == "-" and x ~= 0 then x = -x end\n'
        "local top = period\n"
        "if low < 0 and base == 10 then top = period + low elseif x < 0 then return 0 end\n"
        "if x < low or x >= top then return 0 end\n"
        "if x >= period + low then x = x - period end\n"
        "return x\n"
        "end",
        (),
    ),
    "_string_to_real": (
        "local function _string_to_real(s)\n"
        'for _, m in ipairs({"%d+%.?%d*[eE][+-]?%d+", "%d+%.?%d*", "%.%d+[eE][+-]?%d+", "%.%d+"}) do\n'
        'local sign, n = string.match(s, "^%s*([+-]?)(" .. m .. ")")\n'
        'if n then return tonumber(n) * (sign == "-" and -1.0 or 1.0) end\n'
        "end\n"
        "return 0.0\n"
        "end",
        (),
    ),
    "_string_to_bool": (
        "local function _string_to_bool(s)\n"
        's = string.upper(string.gsub(s, "^BOOL#", ""))\n'
        'return string.sub(s, 1, 4) == "TRUE" or string.sub(s, 1, 1) == "1"\n'
        "end",
        (),
    ),
}
"""Name to definition and the helpers it needs itself."""


def lua_helpers(names: Iterable[str]) -> str:
    """Definitions of the named helpers as locals, those they need first; to stand once above the code using them."""
    ordered: dict[str, str] = {}

    def add(name: str) -> None:
        text, needed = HELPERS[name]
        for other in needed:
            add(other)
        ordered.setdefault(name, text)

    for name in sorted(names):
        add(name)
    return "".join(text + "\n" for text in ordered.values())
