"""What a fuzzer guided by the readers' coverage came upon (study/study_fuzz_guided.py)."""

from pathlib import Path

import pytest

from helpers import fuzz_targets as targets

SEEDS = Path(__file__).with_name("seeds")


@pytest.mark.parametrize("reader", targets.READERS)
def test_what_a_fuzzer_found_is_read_or_refused(tmp_path, reader):
    attempt = targets.reader(reader, tmp_path)
    kept = [path.read_bytes() for path in sorted((SEEDS / reader).iterdir())]
    outcomes = {attempt(data) for data in (*targets.starting_points(reader), *kept)}
    assert outcomes == {"read", "refused"}
