r"""How much light the body sends to the camera: the one formula that every renderer uses.

.. math::

    L = \rho_d \left(\frac{1}{\pi} \sum_j w_j (n l_j)^+ + L_a\right)
        + \sum_j w_j (n l_j)^+ \frac{F(v h_j) D(n h_j)}{4 (v h_j)^2},
    \qquad w_j = A_j \frac{(\cos\theta_j)^b}{r_j^2}

over the sample points j of the lamps, with l towards the lamp, v towards the camera, h the unit
half-vector and D the distribution of the surface's slopes, whose projection on the surface
integrates to one: Beckmann's, :math:`D(c) = \exp(-(1/c^2 - 1)/m^2) / (\pi m^2 c^4)`, or that of
Trowbridge and Reitz, called GGX, :math:`D(c) = m^2 / (\pi (1 + c^2 (m^2 - 1))^2)` [2]_. The
geometry term is that of Kelemen and Szirmay-Kalos, 1/(v h)^2 [1]_: exact in the mirror direction
and smooth everywhere. The reflectance is Schlick's [3]_,
:math:`F(c) = \rho_s + (1 - \rho_s)(1 - c)^5`.

.. [1] C. Kelemen and L. Szirmay-Kalos, "A Microfacet Based Coupled Specular-Matte BRDF Model with
   Importance Sampling", Eurographics short presentations, 2001.
.. [2] B. Walter et al., "Microfacet Models for Refraction through Rough Surfaces", Eurographics
   Symposium on Rendering, 2007, doi:10.2312/EGWR/EGSR07/195-206.
.. [3] C. Schlick, "An Inexpensive BRDF Model for Physically-based Rendering", Computer Graphics
   Forum 13 (1994) 233, doi:10.1111/1467-8659.1330233.
"""

import numpy as np
from numpy.typing import NDArray

from render_sim.scene import Lamp, Scene, Surface

__all__ = ["lamp_samples", "radiance", "reflection"]

Floats = NDArray[np.float64]


def lamp_samples(scene: Scene, lamp: Lamp | None = None, *, roughness: float = np.inf) -> Floats:
    """Return the sample points of a lamp, or of all.

    They lie 1.2 standard deviations of the reflection's lobe on the lamp apart, for which the sum
    over them differs from the integral by some 2e-5; half as far for GGX, whose top is sharper.

    Parameters
    ----------
    scene : Scene
        Its least roughness, markings included, sets how dense they are.
    lamp : Lamp, optional
        The lamp; all of the scene if not given, the one that is measured first.
    roughness : float, optional
        Of the smoothest surface besides those of the scene.

    Returns
    -------
    ndarray
        Of each point [point, 8]: tunnel X, Y, Z [m]; area times radiance [m^2]; unit vector that it
        shines along; exponent of its beam.
    """
    if lamp is None:
        return np.concatenate(
            [
                lamp_samples(scene, each, roughness=roughness)
                for each in (scene.lamp, *scene.other_lamps)
            ]
        )
    centre = np.array(lamp.centre_m)
    reach = float(np.linalg.norm(centre)) - scene.body.radius_m
    smoothest = min(roughness, *(each.roughness for each in scene.surfaces))
    apart = 0.6 if scene.surface.distribution == "ggx" else 1.2
    spacing = apart * np.sqrt(2.0) * smoothest * reach
    along = int(np.ceil(lamp.length_m / spacing))
    across = 1 + int(np.ceil(lamp.width_m / spacing))
    x = ((np.arange(along) + 0.5) / along - 0.5) * lamp.length_m
    nodes, weights = np.polynomial.legendre.leggauss(across)
    xs, ys = np.meshgrid(x, nodes * lamp.width_m / 2, indexing="ij")
    area = np.broadcast_to(weights / 2 * lamp.width_m * lamp.length_m / along, xs.shape)
    samples = np.empty((*xs.shape, 8))
    samples[..., :3] = centre
    samples[..., 0] += xs
    samples[..., 1] += ys
    samples[..., 3] = area * lamp.radiance
    samples[..., 4:7] = _aim(lamp)
    samples[..., 7] = lamp.beam
    return samples.reshape(-1, 8)


def _aim(lamp: Lamp) -> Floats:
    if lamp.aim_m is None:
        return np.array([0.0, 0.0, -1.0])
    along = np.array(lamp.aim_m) - lamp.centre_m
    return np.asarray(along / np.linalg.norm(along))


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
    shone = np.maximum(-np.einsum("...jk,jk->...j", to_lamp, samples[:, 4:7]), 0.0)
    weight = samples[:, 3] * shone ** samples[:, 7] / distance**2
    weight = weight * np.maximum(facing, 0.0)
    # with s = l + v: (n h)^2 = (n s)^2 / |s|^2 and 4 (v h)^2 = |s|^2
    size2 = 2.0 + 2.0 * np.einsum("...jk,...k->...j", to_lamp, to_eye)
    cosine2 = (facing + np.sum(normals * to_eye, axis=-1)[..., None]) ** 2 / size2
    lobe = _distribution(cosine2, surface)
    mirrored = surface.specular + (1 - surface.specular) * (1 - 0.5 * np.sqrt(size2)) ** 5
    matte = surface.diffuse * (weight.sum(axis=-1) / np.pi + surface.ambient)
    specular = (weight * mirrored * lobe / size2).sum(axis=-1)
    return np.asarray(matte), np.asarray(specular)


def _distribution(cosine2: Floats, surface: Surface) -> Floats:
    """Return D for the squared cosine of the angle between normal and half-vector."""
    m2 = surface.roughness**2
    if surface.distribution == "ggx":
        return np.asarray(m2 / (np.pi * (1.0 + cosine2 * (m2 - 1.0)) ** 2))
    return np.asarray(np.exp((1.0 - 1.0 / cosine2) / m2) / (np.pi * m2 * cosine2**2))
