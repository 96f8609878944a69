"""What calibkit 0.2.0 wrote keeps its numbers, its bytes and its proofs: runs, validations, plans,
exports and certificates of every shipped recipe (tests/golden/0.2).
"""

import json
import re
import shutil
import subprocess

import numpy as np
import pytest

from outputs import release_0_2 as release

ROUNDING = {"rtol": 1e-8, "atol": 1e-14}
"""Another processor and other libraries; 1e-6 of a number would be a change."""
PPM_ROUNDING = 1e-8
"""Rounding of a figure in ppm: 1e-14 of the scale factor."""


JUDGED_ANEW = {
    "accelerometer": r"validate /acceptance/0/value",
    "inclinometer": r"validate /(acceptance/0/value|logs/0/(worse_than_uncorrected_over_u|"
    r"stations/\d+/azimuth_standard_uncertainty_deg))",
    release.PAIR: r"validate /(pair/\d/(standard_uncertainty|dof)|acceptance/[0-3]/.*|"
    r"logs/\d/gyros/0/(K|scale_factor_error)_standard_uncertainty(_ppm)?)",
    "gyro_triad": r"validate /acceptance/[0-2]/.*|"
    r"certify /results/gyro_orthogonality\.triad[^/]*\.S_(x[yz]|y[xz]|z[xy])/(expanded_u|cov).*",
    "rate_table": r"validate /(acceptance/[0-57]/.*|"
    r"logs/\d/gyros/0/(K|scale_factor_error)_standard_uncertainty(_ppm)?)|"
    r"certify /results/gyro_scale\.repeatability\..*/interval/[01]",
    release.AUTOPILOT: r"validate /(logs/0/channels/\d/.*over_uncertainty|acceptance/[01]/.*)",
    "fog_thermal": r"certify /results/drift_rate\.drift\.b0/expanded_uncertainty",
    "thermal": r"certify /results/thermal\.\w+\.b0/(expanded_uncertainty|coverage_factor)",
}
"""Uncertainties of unseen runs of gyros, which hold the errors that today's fit knows, and the
criteria by them, with residuals about the line of a run; drifts of unseen warm-ups, which are
judged along the rows that are corrected; U of a bias at 0 °C among the coefficients, which was
smaller than that of the same bias in the table; u of azimuths, where each gyro's turn counts with
its own derivative, no longer the larger of both with the larger; U of sensitivities across, which
holds the angles between the table axes; errors of unseen dwells over u, which has an error of the
attitude at right angles to gravity alone; the interval of a repeatability, which is that of a
standard deviation over few runs.
"""


def without_version(data):
    """Bytes of an export without calibkit's version and what follows from it: length and CRC of a
    blob, digest of a parameter file.
    """
    data = re.sub(rb"calibkit \d[\w.]*|sha256 of all lines above: \w+", b"", data)
    return data[:8] + data[12:-4] if data.startswith(b"CALB") else data


@pytest.fixture
def command_line(calibkit):
    """Run the command line in this process; its stdout, where it ended with 0 or 1."""

    def run(*arguments):
        outcome = calibkit(*arguments)
        assert outcome.code in {0, 1}, outcome.err
        return outcome.out

    return run


@pytest.fixture(autouse=True, params=release.SAMPLES)
def recipe(request):
    """Name of a shipped recipe."""
    return request.param


def test_every_command_gives_the_numbers_of_0_2(recipe, command_line, tmp_path):
    """Coefficients, results at a point, corrected logs, validation, history, comparison and
    certificate are equal to eight digits; blobs and parameter files to the last byte but for the
    version.
    """
    folder = release.FOLDER / recipe
    expected = json.loads((folder / "numbers.json").read_text(encoding="utf-8"))
    numbers = release.use(recipe, command_line, tmp_path)
    # `history` follows no coefficients any more, `compare` tests results, not coefficients together
    gone = ("history /series/", "compare /joint/")
    expected = {key: value for key, value in expected.items() if not key.startswith(gone)}
    assert not expected.keys() - numbers.keys()
    compared = np.array([[numbers[key], value] for key, value in expected.items()])
    # parts per million of a scale factor are the difference of two of its values: their last digits
    # are those of the processor
    ppm = np.array([key.endswith("_ppm") for key in expected])
    wrong = ~np.isclose(*compared.T, **ROUNDING) & ~(
        ppm & np.isclose(*compared.T, rtol=0.0, atol=PPM_ROUNDING)
    )
    changed = [(key, *row) for key, row, bad in zip(expected, compared, wrong, strict=True) if bad]
    anew = re.compile(JUDGED_ANEW.get(recipe, ""))
    assert not [one for one in changed if not anew.fullmatch(one[0])]
    for target in release.targets(recipe):
        if target != "c":
            for path in (folder / target).iterdir():
                if path.suffix not in {".c", ".h"}:  # the loader of a blob is code, not numbers
                    written = (tmp_path / target / path.name).read_bytes()
                    assert without_version(written) == without_version(path.read_bytes())


def test_every_file_of_0_2_verifies(recipe, command_line):
    """Digests of runs, validations, plans and exports hold, and the signature of a certificate is
    that of its laboratory.
    """
    folder = release.FOLDER / recipe
    revisions = sorted((folder / release.SERIAL).iterdir())
    files = [path for target in release.targets(recipe) for path in (folder / target).iterdir()]
    plans = [folder / "plan" / "plan.json"] if release.SAMPLES[recipe].planned else []
    command_line("verify", *revisions, folder / "validation.json", *plans, *files)
    if recipe == release.PAIR:
        trust = ("--trust", folder / "authority.pem", "--at", release.DATE, "--require-signature")
        out = command_line("verify", folder / "certificate.pdf", *trust)
        assert "trusted" in out
    command_line("verify", folder / "certificate.xml")


def test_a_plan_of_0_2_is_simulated_again(recipe, command_line, tmp_path):
    """Its schedule is read and a campaign is run by it."""
    if release.SAMPLES[recipe].planned:
        command_line(
            "simulate",
            "--plan",
            release.FOLDER / recipe / "plan",
            "--seed",
            1,
            "--out",
            tmp_path / "logs",
        )
        assert list((tmp_path / "logs").rglob("*.csv"))


def test_c_of_0_2_proves_itself(recipe, tmp_path):
    """The exported C compiles without a warning and its own test passes."""
    if not release.SAMPLES[recipe].firmware:
        return
    main = tmp_path / "main.c"
    main.write_text(
        '#include "cal.h"\nint main(void) { return cal_selftest(); }\n', encoding="utf-8"
    )
    source = release.FOLDER / recipe / "c"
    program = tmp_path / "program"
    compiler = shutil.which("gcc") or "cc"
    command = [
        compiler,
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Werror",
        f"-I{source}",
        main,
        source / "cal.c",
        "-o",
        program,
    ]
    subprocess.run([*map(str, command), "-lm"], check=True)
    assert subprocess.run([program], check=False).returncode == 0
