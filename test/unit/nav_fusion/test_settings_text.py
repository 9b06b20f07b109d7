"""nav_fusion.settings_text: parameters as they are typed."""

from __future__ import annotations

import pytest
from imu_noise_id.errors import InputError
from nav_fusion.settings_text import parameters_from


@pytest.mark.parametrize(
    "typed", ["[1, 0, 0.1, 0, 2, 0, 0, 0, 3]", "[[1, 0, 0.1], [0, 2, 0], [0, 0, 3]]"]
)
def test_a_matrix_is_taken_row_by_row_as_in_the_yaml_or_in_rows(typed: str) -> None:
    found = parameters_from([f"soft_iron={typed}"]).soft_iron
    assert found == ((1.0, 0.0, 0.1), (0.0, 2.0, 0.0), (0.0, 0.0, 3.0))


@pytest.mark.parametrize(
    "typed", ["[1, 2, 3]", "7", "[[1, 2], [3]]", "[a, 0, 0, 0, 1, 0, 0, 0, 1]"]
)
def test_a_matrix_of_another_shape_is_refused(typed: str) -> None:
    with pytest.raises(InputError, match="soft_iron"):
        parameters_from([f"soft_iron={typed}"])
