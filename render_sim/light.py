r"""How much light the body sends to the camera: the one formula that every renderer uses.

.. math::

    L = \rho_d \left(\frac{1}{\pi} \sum_j w_j (n l_j)^+ + L_a\right)
        + \rho_s \sum_j w_j (n l_j)^+ \frac{D(n h_j)}{4 (v h_j)^2},
    \qquad w_j = A_j \frac{\cos\theta_j}{r_j^2}

over the sample points j of the lamp, with l towards the lamp, v towards the camera, h the unit
half-vector and D Beckmann's distribution, :math:`D(c) = \exp(-(1/c^2 - 1)/m^2) / (\pi m^2 c^4)`,
whose projection on the surface integrates to one. The geometry term is that of Kelemen and
Szirmay-Kalos, 1/(v h)^2 [1]_: exact in the mirror direction and smooth everywhere. Metal has
almost no Fresnel change at these angles; its reflectance is a constant.

.. [1] C. Kelemen and L. Szirmay-Kalos, "A Microfacet Based Coupled Specular-Matte BRDF Model with
   Importance Sampling", Eurographics short presentations, 2001.
"""

import numpy as np
from numpy.typing import NDArray

from render_sim.scene import Scene

__all__ = ["lamp_samples", "radiance", "reflection"]

Floats = NDArray[np.float64]


def lamp_samples(scene: Scene) -> Floats:
    """Return the lamp's sample points.

    They lie 1.2 standard deviations of the reflection's lobe on the lamp apart, for which the sum
    over them differs from the integral by some 2e-5.

    Returns
    -------
    ndarray
        Tunnel X, Y, Z [m] and area times radiance [m^2] of each point [point, 4].
    """
    lamp = scene.lamp
    centre = np.array(lamp.centre_m)
    reach = float(np.linalg.norm(centre)) - scene.body.radius_m
    spacing = 1.2 * np.sqrt(2.0) * scene.surface.roughness * reach
    along = int(np.ceil(lamp.length_m / spacing))
    across = 1 + int(np.ceil(lamp.width_m / spacing))
    x = ((np.arange(along) + 0.5) / along - 0.5) * lamp.length_m
    nodes, weights = np.polynomial.legendre.leggauss(across)
    xs, ys = np.meshgrid(x, nodes * lamp.width_m / 2, indexing="ij")
    area = np.broadcast_to(weights / 2 * lamp.width_m * lamp.length_m / along, xs.shape)
    columns = [centre[0] + xs, centre[1] + ys, np.full_like(xs, centre[2]), area * lamp.radiance]
    return np.stack(columns, axis=-1).reshape(-1, 4)


def radiance(scene: Scene, points_m: Floats, normals: Floats, eye_m: Floats) -> Floats:
    """Return the whole radiance [...] of surface points; see `reflection`."""
    matte, specular = reflection(scene, points_m, normals, eye_m)
    return matte + specular


def reflection(
    scene: Scene, points_m: Floats, normals: Floats, eye_m: Floats
) -> tuple[Floats, Floats]:
    """Return the two parts of the radiance that surface points send towards the camera.

    Parameters
    ----------
    scene : Scene
        Lamp and surface.
    points_m, normals : ndarray
        Points of the surface and unit outward normals, tunnel frame [..., 3] [m].
    eye_m : ndarray
        The camera's perspective centre [3] [m].

    Returns
    -------
    matte, specular : ndarray
        Radiance [...] [as `Lamp.radiance`].
    """
    surface = scene.surface
    samples = lamp_samples(scene)
    to_eye = eye_m - points_m
    to_eye = to_eye / np.linalg.norm(to_eye, axis=-1, keepdims=True)
    to_lamp = samples[:, :3] - points_m[..., None, :]
    distance = np.linalg.norm(to_lamp, axis=-1)
    to_lamp /= distance[..., None]
    facing = np.einsum("...jk,...k->...j", to_lamp, normals)
    weight = samples[:, 3] * np.maximum(to_lamp[..., 2], 0.0) / distance**2
    weight = weight * np.maximum(facing, 0.0)
    # with s = l + v: (n h)^2 = (n s)^2 / |s|^2 and 4 (v h)^2 = |s|^2
    size2 = 2.0 + 2.0 * np.einsum("...jk,...k->...j", to_lamp, to_eye)
    cosine2 = (facing + np.sum(normals * to_eye, axis=-1)[..., None]) ** 2 / size2
    m2 = surface.roughness**2
    lobe = np.exp((1.0 - 1.0 / cosine2) / m2) / (np.pi * m2 * cosine2**2)
    matte = surface.diffuse * (weight.sum(axis=-1) / np.pi + surface.ambient)
    specular = surface.specular * (weight * lobe / size2).sum(axis=-1)
    return np.asarray(matte), np.asarray(specular)
