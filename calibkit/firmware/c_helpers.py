"""Helper functions of the generated sources; a source holds only those that it calls."""

HELPERS = {
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
    "played": (
        """
/* kept brought to between x + range[0] and x + range[1]: a play operator */
static @real @p_played(@real kept, @real x, const @real range[])
{
    const @real least = x + range[0];
    const @real greatest = x + range[1];
    @real y = kept;

    if (y < least) {
        y = least;
    } else if (y > greatest) {
        y = greatest;
    } else {
        /* not pushed */
    }
    return y;
}
"""
    ),
    "slope": (
        """
/* rate of the last values, history[0] the newest: sum of w[i - 1] (history[i] - history[0]) */
static @real @p_slope(@real history[], @real x, uint32_t updates, const @real weights[], uint32_t flag,
                      uint32_t *status)
{
    uint32_t count = @P_WINDOW;
    @real rate = @zero;
    uint32_t i;

    if (updates < @P_WINDOW) {
        count = updates + 1U;
    }
    for (i = @P_WINDOW - 1U; i > 0U; i--) {
        history[i] = history[i - 1U];
    }
    history[0] = x;
    if (count < @P_WINDOW_LEAST) {
        *status |= flag;
    } else {
        const @real *w = &weights[(count - @P_WINDOW_LEAST) * (@P_WINDOW - 1U)];

        for (i = 1U; i < count; i++) {
            rate += w[i - 1U] * (history[i] - history[0]);
        }
    }
    return rate;
}
"""
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
NEAR = """/* whether a computed value is within the tolerance of the expected one; never for a NaN */
static uint32_t @p_near(@real found, @real expected, @real tolerance)
{
    const @real difference = found - expected;

    return ((difference >= -tolerance) && (difference <= tolerance)) ? 1U : 0U;
}
"""
"""What the self-test calls."""


def called_helpers(body: str) -> list[str]:
    """Helpers that a source calls, directly or through another, in the order in which C must see
    them.
    """
    text = body
    helpers: set[str] = set()
    while new := {name for name in HELPERS if f"@p_{name}(" in text} - helpers:
        helpers |= new
        text = "".join(HELPERS[name] for name in new)
    return [text.lstrip("\n") for name, text in HELPERS.items() if name in helpers]
