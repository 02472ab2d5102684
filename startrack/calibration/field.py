"""Table of stars -> fitted cameras of several orders, and the order that the stars support."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core
from startrack.attitude import UNKNOWNS, camera_slopes, huber_weights, moved_camera, typical_square
from startrack.calibration.star_table import StarTable, angles_of
from startrack.core import Advance, Flags, Floats, Ints, Refused, Unit, printed

# Terms that each model adds to a pinhole; a digit is the order of a polynomial.
OPENCV = {"none": (), "radial": ("k1",), "full": ("k1", "k2", "p1", "p2")}
MODELS = (*OPENCV, "1", "2", "3")
HELD = "held"  # a known camera; only its attitude is fitted
POLYNOMIAL_TERMS = {"1": 3, "2": 6, "3": 10}
WARM_TERMS = 3  # 1, u and v grow with temperature: the boresight, and the scale along both axes
OUTLIER = 6.0  # robust sigma, beyond which a residual is left out; noise has none; by hand
MOST_STEPS = 40
SMALLEST_STEP = 1e-4  # sigma
LEAST_RANK = 1e-12  # of the largest eigenvalue, for columns of equal size
FOLDS = 10
LEAST_PER_UNKNOWN = 1.5  # measurements; a model of more unknowns is not tried
SIZES = 128  # pixel: the assumed array is a multiple of this that holds all places


class Order(NamedTuple):
    """Order of the camera that is fitted.

    model  one of MODELS, or HELD
    warm   whether boresight and scale move with temperature
    """

    model: str
    warm: bool = False

    @property
    def unknowns(self) -> int:
        """Number of parameters, including those of the attitude."""
        if self.model == HELD:
            return 3
        own = 4 + len(OPENCV[self.model]) if self.model in OPENCV else 0
        return own + 2 * POLYNOMIAL_TERMS.get(self.model, 0) + 2 * WARM_TERMS * self.warm

    @property
    def turned(self) -> bool:
        """Whether the attitude is a separate unknown: a polynomial contains it in its terms."""
        return self.model in OPENCV or self.model == HELD

    def __str__(self) -> str:
        name = f"polynomial of order {self.model}"
        if self.model in OPENCV:
            name = ", ".join(("pinhole", *OPENCV[self.model]))
        elif self.model == HELD:
            name = "camera as given"
        return f"{name}, with temperature" if self.warm else name


@printed
@dataclass(frozen=True, eq=False)
class FieldFit:
    """A camera fitted to a table.

    order        what was fitted
    camera       at the mean temperature of the table
    attitude     from the axes of the table to those of the camera
    names        of the unknowns: rotation_x, _y, _z (radian, about the camera's axes),
                 focal_length_px, k1, ..., polynomial.x[0], ..., polynomial.y_per_kelvin[2]
    covariance   of these; with a polynomial, attitude and focal length are fixed, because its terms
                 contain shift, rotation and scale
    residual     (n, 2) pixel, of all stars of the table
    weight       (n,) 1, robust weight of each star; 0 for an outlier
    """

    order: Order
    camera: core.Camera
    attitude: Rotation
    names: tuple[str, ...]
    covariance: Floats
    residual: Annotated[Floats, Unit("pixel")]
    weight: Floats

    @property
    def used(self) -> Flags:
        """Stars that are not outliers."""
        return self.weight > 0


@printed
class Unseen(NamedTuple):
    """Residuals on stars outside the fit.

    order    order of the fitted camera
    angle    (n, 2) radian, measured minus true, along the angles of the table; right ascension
             times the cosine of the declination
    pixel    (n, 2) pixel, along columns and rows
    inlier   (n,) within OUTLIER robust sigma
    mean_square, standard_error  pixel^2 per axis, over the inliers; the error is from the folds
    """

    order: Order
    angle: Floats
    pixel: Floats
    inlier: Flags
    mean_square: float
    standard_error: float

    @property
    def rms(self) -> Floats:
        """(2,) radian, along the angles of the table, without outliers."""
        return np.sqrt(np.mean(self.angle[self.inlier] ** 2, axis=0))


def assumed_array(table: StarTable) -> tuple[int, int, tuple[float, float]]:
    """Default columns, rows, and place of the first pixel's centre.

    If some places are below -0.5, places count from the middle of the array, else from its first
    pixel.
    """
    low, high = table.pixel.min(axis=0), table.pixel.max(axis=0)
    if (low < -0.5).any():
        sides = SIZES * np.ceil(2 * np.abs([low, high]).max(axis=0) / SIZES).astype(int)
        return int(sides[0]), int(sides[1]), tuple(((1 - sides) / 2).tolist())
    sides = SIZES * np.ceil((high + 0.5) / SIZES).astype(int)
    return int(sides[0]), int(sides[1]), (0.0, 0.0)


def fit_field(
    table: StarTable, order: Order, columns: int, rows: int, first: tuple[float, float]
) -> FieldFit:
    """Robust least squares of a camera and its attitude.

    Residuals beyond two robust sigma from their median count linearly; residuals beyond OUTLIER are
    left out. All stars of the table must have one attitude.

    columns, rows  pixel, of the array
    first          pixel (x, y) of the table at the centre of the first pixel
    Raises    ValueError if the stars do not determine the camera, or the image is mirrored.
    Accuracy  numerical: steps below 1e-4 of sigma; outliers up to a quarter of the stars move the
              fit by less than its sigma.
    """
    core.one_of(MODELS, order=order.model)
    if order.warm and table.temperature is None:
        raise Refused("the table must have a temperature where the camera moves with it")
    if 2 * len(table) < LEAST_PER_UNKNOWN * order.unknowns:
        raise Refused(
            f"the table must have at least {math.ceil(LEAST_PER_UNKNOWN * order.unknowns / 2)} "
            f"stars for {order.unknowns} unknowns of a {order}, got {len(table)}"
        )
    table = replace(table, pixel=table.pixel - first)
    state = _start(table, columns, rows)
    if order.model not in OPENCV:
        state = _solve(state, table, Order("none"))[0]
    return _fit(state, table, order)


def fit_attitude(table: StarTable, camera: core.Camera, first: tuple[float, float]) -> FieldFit:
    """A known camera on another table: only its attitude is fitted, robustly as in `fit_field`.

    first     pixel (x, y) of the table at the centre of the first pixel
    Raises    ValueError if the stars do not determine the attitude, or the image is mirrored.
    Accuracy  as `fit_field`; a camera with temperature terms uses the temperatures of the table, or
              its own temperature if the table has none.
    """
    if 2 * len(table) < LEAST_PER_UNKNOWN * Order(HELD).unknowns:
        raise Refused(f"the table must have 3 stars or more for an attitude, got {len(table)}")
    table, order = replace(table, pixel=table.pixel - first), Order(HELD)
    start = _start(table, camera.columns, camera.rows)
    return _fit(_State(camera, start.attitude), table, order)


def cross_validate(
    table: StarTable,
    order: Order,
    columns: int,
    rows: int,
    first: tuple[float, float],
    folds: int = FOLDS,
    seed: int = 0,
) -> Unseen:
    """Residual of each star from the camera fitted to all other folds.

    Source: Hastie, Tibshirani and Friedman (2009), The elements of statistical learning, 7.10.

    folds     random parts of the table of nearly equal size
    Raises    as `fit_field`.
    """
    core.whole(2, 10**6, folds=folds)
    shuffled = core.Streams(seed, 0)("folds").permutation(len(table))
    parts = np.array_split(shuffled, min(folds, len(table)))
    angle, pixel = np.empty((2, len(table), 2))
    for part in parts:
        rest = np.ones(len(table), bool)
        rest[part] = False
        fit = fit_field(table.part(rest), order, columns, rows, first)
        angle[part], pixel[part] = residuals(fit, table.part(part), first)
    square = (pixel**2).sum(axis=1) / table.sigma**2
    inlier = square <= OUTLIER**2 * typical_square(square)
    by_fold = np.array(
        [np.mean(square[part][inlier[part]]) / 2 for part in parts if inlier[part].any()]
    )
    error = float(by_fold.std(ddof=1) / math.sqrt(len(by_fold))) if len(by_fold) > 1 else math.inf
    return Unseen(order, angle, pixel, inlier, float(np.mean(square[inlier]) / 2), error)


def cross_validate_all(
    table: StarTable,
    orders: Sequence[Order],
    columns: int,
    rows: int,
    first: tuple[float, float],
    folds: int = FOLDS,
    progress: Advance | None = None,
) -> tuple[Unseen, ...]:
    """`cross_validate` of several orders, without orders that have too many unknowns."""
    least = len(table) - math.ceil(len(table) / min(folds, len(table)))
    results = []
    for order in orders:
        if 2 * least >= LEAST_PER_UNKNOWN * order.unknowns:
            results.append(cross_validate(table, order, columns, rows, first, folds))
        if progress:
            progress(1)
    if not results:
        raise Refused(f"the table must have more stars for any of the orders, got {len(table)}")
    return tuple(results)


def supported_order(results: Sequence[Unseen]) -> Unseen:
    """The order with fewest unknowns whose mean square is within a standard error of the least.

    Source: Hastie et al. (2009), section 7.10, the one-standard-error rule.
    """
    best = min(results, key=lambda result: result.mean_square)
    limit = best.mean_square + best.standard_error
    return min(
        (result for result in results if result.mean_square <= limit),
        key=lambda result: (result.order.unknowns, result.mean_square),
    )


def residuals(fit: FieldFit, table: StarTable, first: tuple[float, float]) -> tuple[Floats, Floats]:
    """Residuals of stars to a camera: (n, 2) radian along the table's angles, (n, 2) pixel."""
    shifted = replace(table, pixel=table.pixel - first)
    state = _State(fit.camera, fit.attitude)
    camera, shift = fit.camera, np.zeros((len(table), 2))
    if camera.polynomial is not None and table.temperature is not None:
        # Moved to the star's place at the temperature of the camera.
        plane = _plane(fit.attitude.apply(table.direction))
        warm = camera.polynomial.shift(plane, table.temperature)
        shift = (warm - camera.polynomial.shift(plane)) * camera.focal_length_px
    seen = fit.attitude.inv().apply(camera.unproject(shifted.pixel - shift))
    measured, true = angles_of(table.kind, seen), angles_of(table.kind, table.direction)
    angle = (measured - true + np.pi) % (2 * np.pi) - np.pi
    if table.kind in ("radec", "vectors"):
        angle[:, 0] *= np.cos(true[:, 1])
    return angle, _residual(state, shifted)


class _State(NamedTuple):
    camera: core.Camera
    attitude: Rotation


def _fit(state: _State, table: StarTable, order: Order) -> FieldFit:
    state, weight, covariance = _solve(state, table, order)
    return FieldFit(
        order=order,
        camera=state.camera,
        attitude=state.attitude,
        names=_names(order),
        covariance=covariance,
        residual=_residual(state, table),
        weight=weight,
    )


def _plane(direction: Floats) -> Floats:
    return np.asarray(direction[:, :2] / direction[:, 2:])


def _predicted(state: _State, table: StarTable) -> Floats:
    """Pixels (n, 2), each at the temperature of its star."""
    camera, direction = state.camera, state.attitude.apply(table.direction)
    pixel = replace(camera, polynomial=None).project(direction)
    if camera.polynomial is None:
        return pixel
    shift = camera.polynomial.shift(_plane(direction), table.temperature)
    return np.asarray(pixel + shift * camera.focal_length_px)


def _residual(state: _State, table: StarTable) -> Floats:
    return np.asarray(table.pixel - _predicted(state, table))


def _start(table: StarTable, columns: int, rows: int) -> _State:
    """A pinhole and its attitude from an affine fit in the plane that touches the mean direction.

    Raises  ValueError if that is not determined, or mirrored.
    """
    mean = table.direction.mean(axis=0)
    mean /= np.linalg.norm(mean)
    if (table.direction @ mean < 0.1).any():
        raise Refused("directions must lie within 84 degrees of their mean")
    turn = Rotation.align_vectors([[0, 0, 1.0]], [mean])[0]
    plane = _plane(turn.apply(table.direction))
    terms = np.column_stack([np.ones(len(plane)), plane])
    if np.linalg.matrix_rank(terms) < 3:
        raise Refused("the stars must lie in more than one line to determine a camera")
    affine, weight = np.empty((3, 2)), np.ones(len(plane))
    for _ in range(MOST_STEPS):
        root = np.sqrt(weight)[:, None]
        affine = np.linalg.lstsq(terms * root, table.pixel * root, rcond=None)[0]
        far = np.linalg.norm(table.pixel - terms @ affine, axis=1)
        weight = 1 / np.maximum(far, 0.1 * np.median(far) + 1e-9)
    linear = affine[1:].T
    if np.linalg.det(linear) <= 0:
        raise Refused(
            "directions and pixels must have one handedness: seen along the boresight, from +x "
            "(columns) to +y (rows) is the turn from the table's first axis to its second or its "
            "reverse; this table is mirrored, so that one column must change its sign"
        )
    focal = math.sqrt(float(np.linalg.det(linear)))
    roll = math.atan2(linear[1, 0] - linear[0, 1], linear[0, 0] + linear[1, 1])
    middle = np.array([(columns - 1) / 2, (rows - 1) / 2])
    axis = np.append(np.linalg.solve(linear, middle - affine[0]), 1.0)
    tilt = Rotation.align_vectors([[0, 0, 1.0]], [axis / np.linalg.norm(axis)])[0]
    attitude = Rotation.from_euler("z", roll) * tilt * turn
    return _State(core.Camera(columns, rows, focal), attitude)


def _names(order: Order) -> tuple[str, ...]:
    names: list[str] = []
    if order.turned:
        names += ["rotation_x", "rotation_y", "rotation_z"]
        names += [UNKNOWNS[k] for k in _free(order)]
    for suffix, count in _tables(order):
        for axis in "xy":
            names += [f"polynomial.{axis}{suffix}[{n}]" for n in range(count)]
    return tuple(names)


def _free(order: Order) -> Ints:
    """Indices of the UNKNOWNS that the pinhole model of this order fits."""
    if order.model == HELD:
        return np.empty(0, int)
    names = ("focal_length_px", *OPENCV[order.model])
    return np.array([UNKNOWNS.index(name) for name in names])


def _tables(order: Order) -> list[tuple[str, int]]:
    """Tables of coefficients: suffix of their names, and number of coefficients per axis."""
    parts = [("", POLYNOMIAL_TERMS.get(order.model, 0))]
    return [part for part in [*parts, ("_per_kelvin", WARM_TERMS * order.warm)] if part[1]]


def _solve(state: _State, table: StarTable, order: Order) -> tuple[_State, Floats, Floats]:
    """Gauss-Newton from a state: the state at the minimum, weights (n,) and covariance."""
    state = _with_polynomial(state, table, order)
    weight, normal = np.ones(len(table)), np.empty((0, 0))
    scale, sift = np.repeat(1 / table.sigma, 2), False
    for n in range(MOST_STEPS):
        residual = _residual(state, table)
        weight = _weights(residual, table.sigma, sift)
        root = np.sqrt(np.repeat(weight, 2)) * scale
        rows, right = _derivatives(state, table, order) * root[:, None], residual.ravel() * root
        step, normal = _least_squares(rows, right, order)
        state = _moved(state, order, step)
        noise = math.sqrt(float(np.median(right**2)))
        small = np.abs(step) <= SMALLEST_STEP * noise * np.sqrt(np.diag(normal))
        if small.all() and sift:
            break
        sift = sift or bool(small.all()) or n >= MOST_STEPS // 2
    right = _residual(state, table).ravel() * scale
    freedom = max(2 * int((weight > 0).sum()) - order.unknowns, 1)
    variance = float((np.repeat(weight, 2) * right**2).sum()) / freedom
    return state, weight, normal * variance


def _least_squares(rows: Floats, right: Floats, order: Order) -> tuple[Floats, Floats]:
    """The step and the inverse of the normal matrix; columns are first scaled to equal size."""
    size = np.sqrt((rows**2).sum(axis=0))
    size[size == 0] = 1.0
    rows = rows / size
    value, vector = np.linalg.eigh(rows.T @ rows)
    if not value[0] > LEAST_RANK * value[-1]:
        raise Refused(
            f"the stars must determine all {order.unknowns} unknowns of a {order}: they lie too "
            "close together, or have one temperature"
        )
    inverse = vector / value @ vector.T
    return inverse @ (rows.T @ right) / size, inverse / np.outer(size, size)


def _weights(residual: Floats, sigma: Floats, sift: bool) -> Floats:
    """Huber's weights (n,), relative to the robust sigma of all; `sift`: 0 beyond OUTLIER."""
    square = (residual**2).sum(axis=1) / sigma**2
    typical = typical_square(square)
    if typical == 0:
        return np.ones(len(square))
    weight = huber_weights(square, typical)
    if sift:
        weight[square > OUTLIER**2 * typical] = 0.0
    return weight


def _with_polynomial(state: _State, table: StarTable, order: Order) -> _State:
    """The state with coefficients of zero."""
    counts = dict(_tables(order))
    if not counts:
        return state
    fixed, growing = counts.get("", 0), counts.get("_per_kelvin", 0)
    kelvin = {}
    if table.temperature is not None:
        mean = round(float(np.mean(table.temperature)), 2)
        kelvin = {"temperature": mean, "reference": mean}
    zero = core.FieldPolynomial(
        (0.0,) * fixed, (0.0,) * fixed, (0.0,) * growing, (0.0,) * growing, **kelvin
    )
    return state._replace(camera=replace(state.camera, polynomial=zero))


def _derivatives(state: _State, table: StarTable, order: Order) -> Floats:
    """Derivatives of the pixels by the unknowns, (2 n, unknowns)."""
    columns: list[Floats] = []
    direction = state.attitude.apply(table.direction)
    if order.turned:
        own, turn = camera_slopes(state.camera, direction)
        slopes = np.concatenate([turn, own[:, :, _free(order)]], axis=2)
        columns += list(slopes.reshape(2 * len(table), -1).T)
    terms = core.monomials(_plane(direction)) * state.camera.focal_length_px
    for suffix, number in _tables(order):
        factor = np.ones(len(table))
        if suffix:
            assert table.temperature is not None
            assert state.camera.polynomial is not None
            factor = table.temperature - state.camera.polynomial.reference
        for axis in (0, 1):
            for n in range(number):
                pair = np.zeros((len(table), 2))
                pair[:, axis] = terms[:, n] * factor
                columns.append(pair.ravel())
    return np.column_stack(columns)


def _moved(state: _State, order: Order, step: Floats) -> _State:
    """The state after a step of the unknowns, in the order of `_names`."""
    camera, attitude, at = state.camera, state.attitude, 0
    if order.turned:
        free = _free(order)
        at = 3 + len(free)
        attitude = Rotation.from_rotvec(step[:3]) * attitude
        camera = moved_camera(camera, free, step[3:at])
    if camera.polynomial is not None:
        tables: dict[str, Any] = {}
        for suffix, number in _tables(order):
            for axis in "xy":
                name = f"{axis}{suffix}"
                old = np.asarray(getattr(camera.polynomial, name))
                tables[name] = tuple((old + step[at : at + number]).tolist())
                at += number
        camera = replace(camera, polynomial=replace(camera.polynomial, **tables))
    return _State(camera, attitude)


def orders_of(table: StarTable, model: str = "auto", warm: bool | None = None) -> tuple[Order, ...]:
    """The orders to try: one model or all, with temperature terms, without them, or both."""
    models = MODELS if model == "auto" else (model,)
    has = table.temperature is not None and float(np.ptp(table.temperature)) > 0
    if warm and not has:
        raise Refused("the table must have stars at different temperatures for temperature terms")
    warms = ((False, True) if has else (False,)) if warm is None else (warm,)
    return tuple(Order(name, hot) for hot in warms for name in models)
