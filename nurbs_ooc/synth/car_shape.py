r"""The outside of a car as a few smooth master shapes: lower body, greenhouse, bonnet, roof, boot lid.

::

                 ____roof____
        screen  /  greenhouse\            x backwards from the bumper, y to the left, z up from the road;
     __bonnet__/______________\\_boot      s runs around the left half from the front's middle (0) to the
    (___________lower body______)         rear's middle (1), t upwards
        (o)               (o)

The lower body and the greenhouse are bicubic B-splines with a hand-made control net of the left half; a
negative s, or one above 1, is the mirrored half. Panels are cut from them by intervals of s and t.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nurbs_ooc.synth.spline import basis_matrix, clamped_knots

Array = npt.NDArray[np.float64]
Table = tuple[tuple[float, ...], ...]

MIRROR = np.array([1.0, -1.0, 1.0])


@dataclass(frozen=True)
class CarShape:
    """Dimensions and nets of one car, mm.

    Attributes:
        length, height: overall.
        wheelbase: (front, rear) x of the axles.
        wheel_radius, track: tyre's outer radius, half the track.
        plan: (x, y) of the lower body's widest line, from the front's middle to the rear's.
        beltline: (x, z) of its upper edge.
        sections: (height share, width share, front inset mm, rear inset mm) from the sill up.
        screen_foot, roof_edge: (x, y) of the greenhouse's lower and upper ring.
        roof_z: height of the upper ring.
        doors: x of the shut lines along the side, from the wing's end to the last door's end.
        boot: whether a lid closes the rear between greenhouse and tail (else the rear window reaches the tail).
    """

    length: float
    height: float
    wheelbase: tuple[float, float]
    wheel_radius: float
    track: float
    plan: Table
    beltline: Table
    sections: Table
    screen_foot: Table
    roof_edge: Table
    roof_z: float
    doors: tuple[float, ...]
    boot: bool

    def belt(self, x: Array) -> Array:
        """Height of the lower body's upper edge."""
        table = np.array(self.beltline)
        return np.interp(x, table[:, 0], table[:, 1])


SECTIONS: Table = (
    (0.00, 0.930, 70.0, 50.0),
    (0.07, 0.975, 18.0, 12.0),
    (0.25, 0.998, 0.0, 0.0),
    (0.45, 1.002, 2.0, 2.0),
    (0.66, 0.998, 22.0, 10.0),
    (0.85, 0.975, 45.0, 22.0),
    (0.96, 0.950, 80.0, 40.0),
    (1.00, 0.905, 150.0, 80.0),
)

GOLF = CarShape(
    length=4150.0, height=1440.0, wheelbase=(885.0, 3396.0), wheel_radius=316.0, track=752.0,
    plan=(
        (0, 0), (0, 260), (14, 500), (70, 690), (230, 805), (480, 850), (800, 866), (1150, 868), (1550, 868),
        (2000, 868), (2450, 868), (2850, 867), (3200, 862), (3550, 850), (3850, 815), (4040, 720), (4120, 540),
        (4148, 280), (4150, 0),
    ),
    beltline=((0, 700), (250, 752), (700, 850), (1150, 925), (1500, 948), (2500, 968), (3300, 990), (4150, 985)),
    sections=SECTIONS,
    screen_foot=(
        (1085, 0), (1085, 280), (1120, 540), (1260, 690), (1600, 742), (2050, 757), (2500, 760), (2950, 752),
        (3400, 730), (3750, 680), (3960, 560), (4030, 300), (4035, 0),
    ),
    roof_edge=(
        (1850, 0), (1850, 240), (1865, 420), (1930, 520), (2080, 560), (2330, 578), (2600, 582), (2900, 576),
        (3180, 560), (3420, 530), (3560, 440), (3610, 240), (3615, 0),
    ),
    roof_z=1392.0, doors=(1330.0, 2330.0, 3020.0), boot=False,
)  # fmt: skip

C_CLASS = CarShape(
    length=4526.0, height=1426.0, wheelbase=(860.0, 3575.0), wheel_radius=314.0, track=752.0,
    plan=(
        (0, 0), (4, 240), (34, 480), (110, 670), (280, 790), (540, 842), (850, 860), (1200, 864), (1600, 864),
        (2050, 864), (2500, 864), (2950, 863), (3350, 858), (3750, 846), (4100, 815), (4340, 735), (4470, 550),
        (4520, 280), (4526, 0),
    ),
    beltline=((0, 690), (250, 745), (700, 838), (1200, 915), (1600, 935), (2600, 955), (3500, 985), (4526, 1005)),
    sections=SECTIONS,
    screen_foot=(
        (1200, 0), (1200, 280), (1240, 530), (1390, 680), (1720, 732), (2150, 748), (2550, 750), (2900, 742),
        (3250, 722), (3560, 680), (3760, 560), (3830, 300), (3840, 0),
    ),
    roof_edge=(
        (1985, 0), (1985, 230), (2000, 400), (2070, 500), (2220, 540), (2430, 556), (2620, 560), (2800, 556),
        (2980, 544), (3130, 515), (3220, 430), (3255, 240), (3260, 0),
    ),
    roof_z=1380.0, doors=(1340.0, 2360.0, 3180.0), boot=True,
)  # fmt: skip


def _evaluate(net: Array, s: Array, t: Array) -> Array:
    """(n_s, n_t, 3) points of a bicubic net (k, l, 3) at s x t; s may run into the mirrored half."""
    turned = np.where(s > 1.0, 2.0 - s, np.abs(s))
    a = basis_matrix(clamped_knots(net.shape[0], 3), 3, turned)
    b = basis_matrix(clamped_knots(net.shape[1], 3), 3, t)
    points = np.einsum("sk,kld,tl->std", a, net, b, optimize=True)
    half = (s < 0.0) | (s > 1.0)
    points[half] *= MIRROR
    points[(s == 0.0) | (s == 1.0), :, 1] = 0.0
    return np.asarray(points)


class Masters:
    """The master shapes of a car, evaluated on grids of their parameters."""

    def __init__(self, shape: CarShape) -> None:
        self.shape = shape
        self._lower = self._lower_net()
        self._glass = self._glass_net()

    def _lower_net(self) -> Array:
        car = self.shape
        plan = np.array(car.plan, np.float64)
        front = np.clip(1.0 - plan[:, 0] / 900.0, 0.0, 1.0) ** 1.5
        rear = np.clip(1.0 - (car.length - plan[:, 0]) / 700.0, 0.0, 1.0) ** 1.5
        net = np.empty((len(plan), len(car.sections), 3))
        for row, (share, width, inset, outset) in enumerate(car.sections):
            net[:, row, 0] = plan[:, 0] + inset * front - outset * rear
            net[:, row, 1] = plan[:, 1] * width
            low = 185.0 + 25.0 * front + 60.0 * rear
            net[:, row, 2] = low + share * (car.belt(plan[:, 0]) - low)
        return net

    def _glass_net(self) -> Array:
        car = self.shape
        foot, top = np.array(car.screen_foot, np.float64), np.array(car.roof_edge, np.float64)
        net = np.empty((len(foot), 5, 3))
        for row, share in enumerate((0.0, 0.25, 0.55, 0.85, 1.0)):
            bulge = 4.0 * share * (1.0 - share)
            net[:, row, :2] = foot + share * (top - foot)
            net[:, row, 1] *= 1.0 + 0.035 * bulge
            net[:, row, 2] = (1.0 - share) * (car.belt(foot[:, 0]) - 18.0) + share * car.roof_z + 14.0 * bulge
        return net

    def lower(self, s: Array, t: Array) -> Array:
        """Lower body: s around, t from the sill (0) to the belt line (1)."""
        return _evaluate(self._lower, s, t)

    def glass(self, s: Array, t: Array) -> Array:
        """Greenhouse: s around, t from its foot (0) to the roof's edge (1)."""
        return _evaluate(self._glass, s, t)

    def s_at(self, x: float, *, glass: bool = False, t: float = 0.5) -> float:
        """The parameter on the left side where the shape has this x."""
        s = np.linspace(0.0, 1.0, 2001)
        return float(np.interp(x, (self.glass if glass else self.lower)(s, np.array([t]))[:, 0, 0], s))

    def t_at(self, z: float, s: float) -> float:
        """The parameter at which the lower body has this height."""
        t = np.linspace(0.0, 1.0, 501)
        return float(np.interp(z, self.lower(np.array([s]), t)[0, :, 2], t))

    def roof(self, a: Array, b: Array) -> Array:
        """Roof: a from the screen (0) to the rear window (1), b from right (-1) to left (1)."""
        front, rear = self.pillars
        top = np.array([1.0])
        side = self.glass(front + a * (rear - front), top)[:, 0]
        screen = self.glass(np.append(b, 1.0) * front, top)[:, 0]
        window = self.glass(1.0 - np.append(b, 1.0) * (1.0 - rear), top)[:, 0]
        crown = self.shape.height - self.shape.roof_z
        points = _across(side, screen, crown, a, 0.0)
        late = (a**2)[:, None] * (3.0 - 2.0 * a)[:, None]
        points[:, :, 0] += late * (window[:-1, 0] - window[-1, 0])
        points[:, :, 2] -= late * crown * (1.0 - (window[:-1, 1] / window[-1, 1]) ** 2)
        return points

    def bonnet(self, a: Array, b: Array, ends: tuple[float, float], draw: float) -> Array:
        """Bonnet: a from the grille to the screen along s = ends; its rear edge is drawn forward by ``draw`` mm."""
        top = np.array([1.0])
        side = self.lower(ends[0] + a * (ends[1] - ends[0]), top)[:, 0]
        return _across(side, self.lower(np.append(b, 1.0) * ends[0], top)[:, 0], 46.0, a, -draw)

    def boot(self, a: Array, b: Array, ends: tuple[float, float], draw: float) -> Array:
        """Boot lid: a from the tail to the rear window along s = ends; its front edge is drawn back by ``draw`` mm."""
        top = np.array([1.0])
        side = self.lower(ends[0] + a * (ends[1] - ends[0]), top)[:, 0]
        return _across(side, self.lower(1.0 - np.append(b, 1.0) * (1.0 - ends[0]), top)[:, 0], 26.0, a, draw)

    @property
    def pillars(self) -> tuple[float, float]:
        """Where along s the roof's front and rear edges turn into its sides."""
        return 0.24, 0.80


def _across(side: Array, rim: Array, crown: float, a: Array, draw: float) -> Array:
    """(n_a, n_b, 3): from one side of the car to the other, beginning along a rounded rim.

    Args:
        side: (n_a, 3) the left border; at a = 0 it is the rim's left end.
        rim: (n_b + 1, 3) the first border from right to left, and once more its left end.
        crown: height of the middle over the sides at a = 1, mm.
        a: (n_a,) 0 at the rim, 1 at the end.
        draw: shift of the end's middle along x, mm.
    """
    rim, end = rim[:-1], rim[-1]
    share = rim[:, 1] / end[1]
    fade, across = (1.0 - a[:, None]) ** 2, 1.0 - share**2
    points = np.empty((len(a), len(rim), 3))
    points[:, :, 0] = side[:, :1] + fade * (rim[:, 0] - end[0]) + draw * a[:, None] ** 2 * across
    points[:, :, 1] = side[:, 1:2] * share
    points[:, :, 2] = side[:, 2:] + fade * (rim[:, 2] - end[2]) + crown * (a * (2.0 - a))[:, None] * across
    return points
