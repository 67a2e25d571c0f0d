"""A laser ranging tool, as `cell.yaml` describes it. Metres and radians."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Ranging:
    """A tool that scans a picture with a beam of modulated light, and measures its phase after the way there and back.

    `eye` is the feature of the tool that it looks from, along z. The picture is `width` by `height` pixels and `view_rad` wide.
    A range is known modulo half of `wavelength_m`. `noise_m` is its standard deviation on a surface square to the beam at `at_m`;
    it is the noise of the signal by its strength, so it grows with the square of the range and with the incidence. `beam_rad` is
    the full divergence of the beam (where the intensity is 1/e^2), `pointing_rad` the standard deviation of its direction across either axis.
    There is no answer where the signal is weaker than that at `at_m` of a surface seen at `grazing_rad`, and none from a share
    `dropouts` of the pixels.
    """

    eye: str
    width: int
    height: int
    view_rad: float
    wavelength_m: float
    noise_m: float
    at_m: float
    beam_rad: float
    pointing_rad: float = 0.0
    grazing_rad: float = 1.3962634015954636
    dropouts: float = 0.0
