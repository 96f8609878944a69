"""Helper functions of the generated sources; a source holds only those that it calls."""


def _slope(value: str, weight: str, arguments: str, product: str) -> str:
    """Function of a slope for types of values and weights, its last arguments, and the product of a
    weight and a difference.
    """
    return f"""
/* rate of the last values, history[0] the newest: sum of w[i - 1] (history[i] - history[0]) */
static {value} @p_slope({value} history[], {value} x, uint32_t updates, const {weight} weights[], {arguments})
{{
    uint32_t count = @P_WINDOW;
    {value} rate = @zero;
    uint32_t i;

    if (updates < @P_WINDOW) {{
        count = updates + 1U;
    }}
    for (i = @P_WINDOW - 1U; i > 0U; i--) {{
        history[i] = history[i - 1U];
    }}
    history[0] = x;
    if (count < @P_WINDOW_LEAST) {{
        *status |= flag;
    }} else {{
        const {weight} *w = &weights[(count - @P_WINDOW_LEAST) * (@P_WINDOW - 1U)];

        for (i = 1U; i < count; i++) {{
            rate += {product};
        }}
    }}
    return rate;
}}
"""


def _played(value: str, weight: str) -> str:
    """Function of a play operator for types of values and distances."""
    return f"""
/* kept brought to between x + range[0] and x + range[1]: a play operator */
static {value} @p_played({value} kept, {value} x, const {weight} range[])
{{
    const {value} least = x + range[0];
    const {value} greatest = x + range[1];
    {value} y = kept;

    if (y < least) {{
        y = least;
    }} else if (y > greatest) {{
        y = greatest;
    }} else {{
        /* not pushed */
    }}
    return y;
}}
"""


FLOAT = {
    "limited": (
        """
/* x brought into [range[0], range[1]] */
static @real @p_limited(@real x, const @real range[], uint32_t flag, uint32_t *status)
{
    @real y = x;

    if (x < range[0]) {
        y = range[0];
        *status |= flag;
    } else if (x > range[1]) {
        y = range[1];
        *status |= flag;
    } else {
        /* inside */
    }
    return y;
}
"""
    ),
    "indicated": (
        """
/* an indication as it is, which may be outside [range[0], range[1]] */
static @real @p_indicated(@real x, const @real range[], uint32_t beyond, uint32_t *status)
{
    if ((x < range[0]) || (x > range[1])) {
        *status |= beyond;
    }
    return x;
}
"""
    ),
    "mapped": (
        """
/* u = (x - middle) / half, brought into its range */
static @real @p_mapped(@real x, const @p_map *map, uint32_t flag, uint32_t *status)
{
    const @real u = (x - map->middle) * map->reciprocal;

    return @p_limited(u, map->range, flag, status);
}
"""
    ),
    "polynomial": (
        """
/* c[0] + c[1] x + ... + c[count - 1] x^(count - 1) by Horner's scheme: ascending, index = power */
static @real @p_polynomial(const @real c[], uint32_t count, @real x)
{
    @real y = c[count - 1U];
    uint32_t k;

    for (k = count - 1U; k > 0U; k--) {
        y = (y * x) + c[k - 1U];
    }
    return y;
}
"""
    ),
    "played": _played("@real", "@real"),
    "slope": _slope(
        "@real",
        "@real",
        "uint32_t flag,\n                      uint32_t *status",
        "w[i - 1U] * (history[i] - history[0])",
    ),
    "finite": (
        """
/* 0 for a NaN or an infinity */
static uint32_t @p_finite(@real x)
{
    return ((x >= -@max) && (x <= @max)) ? 1U : 0U;
}
"""
    ),
}
"""Floating point."""

NEAR = """/* whether a computed value is within the tolerance of the expected one; never for a NaN */
static uint32_t @p_near(@real found, @real expected, @real tolerance)
{
    const @real difference = found - expected;

    return ((difference >= -tolerance) && (difference <= tolerance)) ? 1U : 0U;
}
"""
"""What the self-test of a floating format calls."""

FIXED = {
    "limited": (
        """
/* x brought into [range[0], range[1]] */
static int32_t @p_limited(@wide x, const @word range[], uint32_t flag, uint32_t *status)
{
    @wide y = x;

    if (x < (@wide)range[0]) {
        y = range[0];
        *status |= flag;
    } else if (x > (@wide)range[1]) {
        y = range[1];
        *status |= flag;
    } else {
        /* inside */
    }
    return (int32_t)y;
}
"""
    ),
    "indicated": (
        """
/* an indication up to the full scale [range[2], range[3]]; [range[0], range[1]] is the fitted range */
static int32_t @p_indicated(@wide x, const @word range[], uint32_t beyond, uint32_t over, uint32_t *status)
{
    if ((x < (@wide)range[0]) || (x > (@wide)range[1])) {
        *status |= beyond;
    }
    return @p_limited(x, &range[2], over, status);
}
"""
    ),
    "rounded": (
        """
/* x 2^-places, halves up, 1 <= places; only unsigned words are shifted, which C defines for every value */
static @wide @p_rounded(@wide x, uint32_t places)
{
    const @uwide bias = (@uwide)1U << @topU;
    const uint32_t before = places - 1U;
    const @uwide half = (@uwide)1U << before;
    const @uwide word = (@uwide)x + bias + half;
    const @uwide lifted = word >> places;
    const @uwide lift = bias >> places;

    return (@wide)lifted - (@wide)lift;
}
"""
    ),
    "scaled": (
        """
/* a b 2^-places */
static int32_t @p_scaled(int32_t a, int32_t b, uint32_t places)
{
    return (int32_t)@p_rounded((@wide)a * (@wide)b, places);
}
"""
    ),
    "mapped": (
        """
/* u = (x - middle) / half by a reciprocal of @reciprocal bits, brought into its range */
static int32_t @p_mapped(int32_t x, const @p_map *map, uint32_t flag, uint32_t *status)
{
    const @wide distance = (@wide)x - (@wide)map->middle;
    const @wide u = @p_rounded(distance * (@wide)map->reciprocal, map->places);

    return @p_limited(u, map->range, flag, status);
}
"""
    ),
    "polynomial": (
        """
/* c[0] + c[1] x + ... + c[count - 1] x^(count - 1) by Horner's scheme: ascending, index = power */
static int32_t @p_polynomial(const @word c[], uint32_t count, int32_t x, uint32_t places)
{
    int32_t y = c[count - 1U];
    uint32_t k;

    for (k = count - 1U; k > 0U; k--) {
        y = @p_scaled(y, x, places) + c[k - 1U];
    }
    return y;
}
"""
    ),
    "quotient": (
        """
/* numerator 2^places / denominator, cut off towards 0 */
static int32_t @p_quotient(int32_t numerator, int32_t denominator, uint32_t places)
{
    const @uwide factor = (@uwide)1U << places;
    const @wide ratio = ((@wide)numerator * (@wide)factor) / (@wide)denominator;

    return (int32_t)ratio;
}
"""
    ),
    "played": _played("int32_t", "@word"),
    "slope": _slope(
        "int32_t",
        "@word",
        "uint32_t places,\n                        uint32_t flag, uint32_t *status",
        "@p_scaled(w[i - 1U], history[i] - history[0], places)",
    ),
    "narrow": (
        """
/* an output word of 16 bits from one of 32; never the word that stands for no number */
static int16_t @p_narrow(int32_t x)
{
    static const int32_t range[2] = {-32767, 32767};
    uint32_t ignored = 0U;

    return (int16_t)@p_limited(@p_rounded((@wide)x, 16U), range, 0U, &ignored);
}
"""
    ),
}
"""Fixed point: values are int32_t, products @wide."""


def called_helpers(body: str, *, fixed: bool) -> list[str]:
    """Helpers that a source calls, directly or through another, in the order in which C must see
    them.
    """
    table, text = FIXED if fixed else FLOAT, body
    called: set[str] = set()
    while new := {name for name in table if f"@p_{name}(" in text} - called:
        called |= new
        text = "".join(table[name] for name in new)
    return [text.lstrip("\n") for name, text in table.items() if name in called]
