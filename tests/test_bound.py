import numpy as np
import pytest

from glint_aoa.optical.bound import centre_information, pixel_variance, slope_std_bound


def gaussian(sigma, peak, n_lines=60, centre=30.2):
    row = np.arange(n_lines)[:, None] - centre
    image = peak * np.exp(-0.5 * (row / sigma) ** 2)
    return image, image * row / sigma**2


def test_white_noise_on_a_gaussian_has_a_closed_form():
    sigma, peak, noise = 2.0, 100.0, 1.5
    _, gradient = gaussian(sigma, peak)
    information = centre_information(gradient, np.full_like(gradient, noise**2))
    # Integral of the squared derivative of a Gaussian: peak^2 sqrt(pi) / (2 sigma).
    expected = peak**2 * np.sqrt(np.pi) / (2 * sigma) / noise**2
    assert information[0] == pytest.approx(expected, rel=1e-9)


def test_shot_noise_on_a_gaussian_is_sigma_over_root_n():
    sigma, peak, electrons = 2.0, 100.0, 40.0
    image, gradient = gaussian(sigma, peak)
    information = centre_information(gradient, image / electrons)
    n_electrons = peak * sigma * np.sqrt(2 * np.pi) * electrons
    assert 1 / np.sqrt(information[0]) == pytest.approx(sigma / np.sqrt(n_electrons), rel=1e-9)


def test_slope_of_evenly_informed_columns():
    u = np.arange(38) * 20.0
    bound = slope_std_bound(np.full(38, 4.0), u)
    assert bound == pytest.approx(0.5 / np.sqrt(((u - u.mean()) ** 2).sum()), rel=1e-12)


def test_slope_bound_is_that_of_weighted_least_squares():
    rng = np.random.default_rng(4)
    u, information = np.arange(30.0), rng.uniform(0.5, 2, 30)
    design = np.stack([np.ones(30), u], 1)
    covariance = np.linalg.inv(design.T @ (information[:, None] * design))
    assert slope_std_bound(information, u) == pytest.approx(np.sqrt(covariance[1, 1]), rel=1e-12)


def test_noise_adds_in_quadrature():
    got = pixel_variance(160.0, read_noise=0.7, electrons_per_grey=160.0)
    assert got == pytest.approx(1 + 0.49 + 1 / 12)


def test_the_design_example_is_as_small_as_it_says():
    """Sigma 1.4 lines, peak 170, read noise 0.7, full well 40,000 e-: 0.0008 deg, 0.0002 deg."""
    image, gradient = gaussian(1.4, 170.0)
    variance = pixel_variance(image, read_noise=0.7, electrons_per_grey=40_000 / 255)
    j = centre_information(gradient, variance)[0]
    aspect = 27.5 / 11.7
    for u, degrees in ((np.arange(10, 752, 20), 0.0008), (np.arange(752), 0.0002)):
        bound = np.degrees(slope_std_bound(np.full(u.size, j), u) * aspect)
        assert bound == pytest.approx(degrees, abs=5e-5)
