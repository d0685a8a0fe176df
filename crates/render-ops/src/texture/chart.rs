//! From coordinates to places on the faces of a texture.
//!
//! # Forward
//! A texture of the plane has one face, and coordinates (u, v) are places on it once they have been
//! brought back by the border's rule: `u - floor(u)` (wrap), the distance from the nearest even number
//! (mirror), the nearest of `[0, 1]` (clamp).
//!
//! A cube map has six, in the order +x, -x, +y, -y, +z, -z. A direction d meets the face of its largest
//! component m; of components that are as large, the first one. With the face's axes `a_s`, `a_t`:
//! `s = (a_s . d / |m| + 1) / 2`, and t likewise.
//!
//! # Backward
//! `ds/dd = (a_s - s' sign(m) e_m) / (2 |m|)`, `s' = a_s . d / |m|`. From pixel to pixel places change
//! by `J = ds/dd D`, with D the change of the direction: `J_s = (a_s . D - s' sign(m) D_m) / (2 |m|)`.
//! So with `P_s = (J_s)_bar / (2 |m|)`: `D_bar += a_s P_s`, `D_bar_m -= s' sign(m) P_s`,
//! `s'_bar -= sign(m) D_m . P_s`, `|m|_bar -= J_s . (J_s)_bar / |m|`.
//!
//! # Where it is not smooth
//! On the edges between faces of a cube, and where a coordinate is brought back: there the texture
//! goes on, but its slope may differ.
//!
//! # Source
//! OpenGL 4.6, section 8.13, for the faces of a cube map and their axes.

use bokashi_core::Scalar;

use super::lanes::{LANES, Lanes};
use super::options::TextureBorder;
use crate::cube_faces::towards_texel;

/// A place on a face of a texture: (0, 0) is its upper left corner and (1, 1) its lower right corner.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place<T> {
    pub(super) face: usize,
    pub(super) position: [T; 2],
}

/// The places of a block of probes.
#[derive(Debug)]
pub(super) struct Places<T> {
    pub(super) faces: Lanes<u8>,
    pub(super) positions: [Lanes<T>; 2],
}

impl<T: Scalar> Places<T> {
    pub(super) fn new() -> Self {
        Self { faces: [0; LANES], positions: [[T::ZERO; LANES]; 2] }
    }
}

/// The texels that stand for a texel beyond a face: each with the weight 1 over their number.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Texels {
    /// A face, a row and a column.
    pub(super) texels: [[usize; 3]; 3],
    pub(super) count: usize,
}

impl Texels {
    fn one(texel: [usize; 3]) -> Self {
        Self { texels: [texel; 3], count: 1 }
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &[usize; 3]> {
        self.texels[..self.count].iter()
    }
}

/// How `K` coordinates become places.
pub(super) trait Chart<const K: usize>: Copy + Send + Sync + 'static {
    /// The operation that it belongs to.
    const OPERATION: &'static str;
    /// The number of faces.
    const FACES: usize;
    /// Whether a footprint depends on where its coordinates are.
    const IS_CURVED: bool;

    /// The place of coordinates.
    fn locate<T: Scalar>(self, coordinates: [T; K]) -> Place<T>;

    /// The places of the first `count` coordinates.
    #[inline(always)]
    fn locate_all<T: Scalar>(
        self,
        coordinates: &[Lanes<T>; K],
        count: usize,
        places: &mut Places<T>,
    ) {
        let count = count.min(LANES);
        for i in 0..count {
            let mut point = [T::ZERO; K];
            for k in 0..K {
                point[k] = coordinates[k][i];
            }
            let Place { face, position } = self.locate(point);
            places.faces[i] = face as u8;
            places.positions[0][i] = position[0];
            places.positions[1][i] = position[1];
        }
    }

    /// The gradients of coordinates from the gradient of their place.
    fn pull_back<T: Scalar>(self, coordinates: [T; K], position_bar: [T; 2]) -> [T; K];

    /// The gradients of the first `count` coordinates from the gradients of their places.
    #[inline(always)]
    fn pull_back_all<T: Scalar>(
        self,
        coordinates: &[Lanes<T>; K],
        count: usize,
        position_bars: &[Lanes<T>; 2],
        bars: &mut [Lanes<T>; K],
    ) {
        for i in 0..count.min(LANES) {
            let mut point = [T::ZERO; K];
            for k in 0..K {
                point[k] = coordinates[k][i];
            }
            let point = self.pull_back(point, [position_bars[0][i], position_bars[1][i]]);
            for k in 0..K {
                bars[k][i] = point[k];
            }
        }
    }

    /// How the place changes from pixel to pixel, where the coordinates change by `slopes`.
    fn slopes<T: Scalar>(self, coordinates: [T; K], slopes: [[T; 2]; K]) -> [[T; 2]; 2];

    /// The gradients of coordinates and of their slopes from those of the place's slopes.
    fn pull_back_slopes<T: Scalar>(
        self,
        coordinates: [T; K],
        slopes: [[T; 2]; K],
        bars: [[T; 2]; 2],
    ) -> ([T; K], [[T; 2]; K]);

    /// What stands for `texel`, a row and a column of a face, which may lie beyond its `[rows, columns]` by
    /// one.
    fn beyond(self, extents: [usize; 2], face: usize, texel: [isize; 2]) -> Texels;

    /// Whether places beyond a face along each of its axes show nothing.
    fn ends(self) -> [bool; 2];
}

#[inline(always)]
fn floor<T: Scalar>(x: T) -> T {
    T::from_f64(x.to_f64().floor())
}

/// A texture of the plane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    /// Along u and along v.
    pub(super) borders: [TextureBorder; 2],
}

/// A coordinate brought back into `[0, 1]`, and how that changes with it.
type Reduced<T> = [T; 2];

/// Whether a number has a fraction: not where it is too large, infinite or NaN.
#[inline(always)]
fn has_fraction<T: Scalar>(u: T) -> bool {
    u.abs() < T::from_f64(1e15)
}

#[inline(always)]
fn wrapped<T: Scalar>(u: T) -> Reduced<T> {
    if has_fraction(u) { [u - floor(u), T::ONE] } else { [T::ZERO; 2] }
}

#[inline(always)]
fn mirrored<T: Scalar>(u: T) -> Reduced<T> {
    let two = T::from_f64(2.0);
    let phase = u - two * floor(u / two);
    let [phase, slope] = if phase > T::ONE { [two - phase, -T::ONE] } else { [phase, T::ONE] };
    if has_fraction(u) { [phase, slope] } else { [T::ZERO; 2] }
}

#[inline(always)]
fn clamped<T: Scalar>(u: T) -> Reduced<T> {
    let end = if u > T::ZERO { T::ONE } else { T::ZERO };
    if u > T::ZERO && u < T::ONE { [u, T::ONE] } else { [end, T::ZERO] }
}

/// As it is where there is something.
#[inline(always)]
fn beyond_is_nothing<T: Scalar>(u: T) -> Reduced<T> {
    if u > -T::ONE && u < T::from_f64(2.0) { [u, T::ONE] } else { [-T::ONE, T::ZERO] }
}

/// Calls `visit(number, reduced)` for all of `numbers`.
#[inline(always)]
fn for_each_reduced<T: Scalar>(
    coordinates: &[T],
    numbers: &mut [T],
    reduced: impl Fn(T) -> Reduced<T>,
    visit: impl Fn(&mut T, Reduced<T>),
) {
    for (number, u) in numbers.iter_mut().zip(coordinates) {
        visit(number, reduced(*u));
    }
}

impl Plane {
    /// The coordinate along an axis, brought back.
    #[inline(always)]
    fn reduced<T: Scalar>(self, axis: usize, u: T) -> Reduced<T> {
        match self.borders[axis] {
            TextureBorder::Wrap => wrapped(u),
            TextureBorder::Mirror => mirrored(u),
            TextureBorder::Clamp => clamped(u),
            TextureBorder::Zero => beyond_is_nothing(u),
        }
    }

    /// Calls `visit(number, reduced)` for all of `numbers`, along an axis. A loop without a choice in it is a
    /// vector's.
    #[inline(always)]
    fn for_each<T: Scalar>(
        self,
        axis: usize,
        coordinates: &[T],
        numbers: &mut [T],
        visit: impl Fn(&mut T, Reduced<T>),
    ) {
        match self.borders[axis] {
            TextureBorder::Wrap => for_each_reduced(coordinates, numbers, wrapped, visit),
            TextureBorder::Mirror => for_each_reduced(coordinates, numbers, mirrored, visit),
            TextureBorder::Clamp => for_each_reduced(coordinates, numbers, clamped, visit),
            TextureBorder::Zero => {
                for_each_reduced(coordinates, numbers, beyond_is_nothing, visit);
            }
        }
    }
}

impl Chart<2> for Plane {
    const OPERATION: &'static str = "sample_texture";
    const FACES: usize = 1;
    const IS_CURVED: bool = false;

    #[inline(always)]
    fn locate<T: Scalar>(self, coordinates: [T; 2]) -> Place<T> {
        let [u, v] = coordinates;
        Place { face: 0, position: [self.reduced(0, u)[0], self.reduced(1, v)[0]] }
    }

    #[inline(always)]
    fn locate_all<T: Scalar>(
        self,
        coordinates: &[Lanes<T>; 2],
        count: usize,
        places: &mut Places<T>,
    ) {
        for k in 0..2 {
            self.for_each(
                k,
                &coordinates[k][..count],
                &mut places.positions[k][..count],
                #[inline(always)]
                |position, [u, _]| *position = u,
            );
        }
    }

    #[inline(always)]
    fn pull_back<T: Scalar>(self, coordinates: [T; 2], position_bar: [T; 2]) -> [T; 2] {
        let [u, v] = coordinates;
        [self.reduced(0, u)[1] * position_bar[0], self.reduced(1, v)[1] * position_bar[1]]
    }

    #[inline(always)]
    fn pull_back_all<T: Scalar>(
        self,
        coordinates: &[Lanes<T>; 2],
        count: usize,
        position_bars: &[Lanes<T>; 2],
        bars: &mut [Lanes<T>; 2],
    ) {
        *bars = *position_bars;
        for k in 0..2 {
            self.for_each(
                k,
                &coordinates[k][..count],
                &mut bars[k][..count],
                #[inline(always)]
                |bar, [_, slope]| *bar = slope * *bar,
            );
        }
    }

    // How large a footprint is does not depend on where the coordinates are.

    #[inline(always)]
    fn slopes<T: Scalar>(self, _: [T; 2], slopes: [[T; 2]; 2]) -> [[T; 2]; 2] {
        slopes
    }

    #[inline(always)]
    fn pull_back_slopes<T: Scalar>(
        self,
        _: [T; 2],
        _: [[T; 2]; 2],
        bars: [[T; 2]; 2],
    ) -> ([T; 2], [[T; 2]; 2]) {
        ([T::ZERO; 2], bars)
    }

    fn beyond(self, extents: [usize; 2], _: usize, texel: [isize; 2]) -> Texels {
        let source = |k: usize| {
            let (texel, extent) = (texel[k], extents[k] as isize);
            // Rows follow each other along v, and columns along u.
            match self.borders[1 - k] {
                // Beyond by one, so that no division is needed.
                TextureBorder::Wrap if texel < 0 => Some((texel + extent) as usize),
                TextureBorder::Wrap if texel >= extent => Some((texel - extent) as usize),
                TextureBorder::Wrap => Some(texel as usize),
                // One beyond the border its mirror image is the border itself.
                TextureBorder::Mirror | TextureBorder::Clamp => {
                    Some(texel.clamp(0, extent - 1) as usize)
                }
                TextureBorder::Zero => (0..extent).contains(&texel).then_some(texel as usize),
            }
        };
        match [source(0), source(1)] {
            [Some(row), Some(column)] => Texels::one([0, row, column]),
            _ => Texels::default(),
        }
    }

    #[inline(always)]
    fn ends(self) -> [bool; 2] {
        self.borders.map(|border| border == TextureBorder::Zero)
    }
}

/// The six faces of a cube.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cube;

/// The face that a direction meets. All is chosen without branches, so that loops over directions become vectors'.
#[derive(Debug, Clone, Copy)]
struct Face<T> {
    /// Whether its normal is along x, or along z.
    on_x: bool,
    on_z: bool,
    /// 1 where its normal is along the axis, -1 where it is against it.
    sign: T,
}

impl<T: Scalar> Face<T> {
    #[inline(always)]
    fn met_by(direction: [T; 3]) -> Self {
        let [x, y, z] = direction.map(T::abs);
        // Of components of one size the first counts, so each direction has one face.
        let on_x = (x >= y) & (x >= z);
        let face = Self { on_x, on_z: !on_x & (z > y), sign: T::ONE };
        let [x, y, z] = direction;
        Self { sign: if face.choose([x, y, z]) < T::ZERO { -T::ONE } else { T::ONE }, ..face }
    }

    /// Of what there is for the faces along each axis, that for this face.
    #[inline(always)]
    fn choose(self, [x, y, z]: [T; 3]) -> T {
        let others = if self.on_z { z } else { y };
        if self.on_x { x } else { others }
    }

    #[inline(always)]
    fn number(self) -> u8 {
        let axis = u8::from(!self.on_x) + u8::from(self.on_z);
        2 * axis + u8::from(self.sign < T::ZERO)
    }

    /// How far the face is along a direction that meets it.
    #[inline(always)]
    fn depth(self, direction: [T; 3]) -> T {
        self.choose(direction).abs()
    }

    /// A vector's components along s and t of the face, as `cube_faces::AXES` has them, and along its normal.
    #[inline(always)]
    fn turn(self, [x, y, z]: [T; 3]) -> [T; 3] {
        let sign = self.sign;
        let s = self.choose([-(sign * z), x, sign * x]);
        let t = self.choose([-y, sign * z, -y]);
        [s, t, sign * self.choose([x, y, z])]
    }

    /// The vector with these components.
    #[inline(always)]
    fn turn_back(self, [s, t, normal]: [T; 3]) -> [T; 3] {
        let (sign, normal) = (self.sign, self.sign * normal);
        let x = self.choose([normal, s, sign * s]);
        let y = self.choose([-t, normal, -t]);
        let z = self.choose([-(sign * s), sign * t, normal]);
        [x, y, z]
    }
}

impl Chart<3> for Cube {
    const OPERATION: &'static str = "sample_cube_map";
    const FACES: usize = 6;
    const IS_CURVED: bool = true;

    #[inline(always)]
    fn locate<T: Scalar>(self, direction: [T; 3]) -> Place<T> {
        let face = Face::met_by(direction);
        let ([s, t, _], depth) = (face.turn(direction), face.depth(direction));
        let half = T::from_f64(0.5);
        let position = [s, t].map(|along| {
            // A sum of probes may be no direction at all.
            let coordinate = half * (along / depth) + half;
            if coordinate >= T::ZERO { coordinate.minimum_number(T::ONE) } else { T::ZERO }
        });
        Place { face: usize::from(face.number()), position }
    }

    #[inline(always)]
    fn pull_back<T: Scalar>(self, direction: [T; 3], position_bar: [T; 2]) -> [T; 3] {
        let face = Face::met_by(direction);
        let ([s, t, _], depth) = (face.turn(direction), face.depth(direction));
        // A ratio `s / d` has the slopes `1 / d` with s and `-(s / d) / d` with d.
        let [s_bar, t_bar] = position_bar.map(|bar| T::from_f64(0.5) * bar / depth);
        face.turn_back([s_bar, t_bar, -(s / depth * s_bar) - t / depth * t_bar])
    }

    #[inline(always)]
    fn slopes<T: Scalar>(self, direction: [T; 3], slopes: [[T; 2]; 3]) -> [[T; 2]; 2] {
        let face = Face::met_by(direction);
        let ([s, t, _], depth) = (face.turn(direction), face.depth(direction));
        let scale = T::from_f64(0.5) / depth;
        let turned = [0, 1].map(|k| face.turn(slopes.map(|slopes| slopes[k])));
        [0, 1].map(|i| {
            let ratio = [s, t][i] / depth;
            turned.map(|slopes| scale * (slopes[i] - ratio * slopes[2]))
        })
    }

    #[inline(always)]
    fn pull_back_slopes<T: Scalar>(
        self,
        direction: [T; 3],
        slopes: [[T; 2]; 3],
        bars: [[T; 2]; 2],
    ) -> ([T; 3], [[T; 2]; 3]) {
        let face = Face::met_by(direction);
        let ([s, t, _], depth) = (face.turn(direction), face.depth(direction));
        let here = self.slopes(direction, slopes);
        let turned = [0, 1].map(|k| face.turn(slopes.map(|slopes| slopes[k])));
        let (mut bar, mut turned_bars) = ([T::ZERO; 3], [[T::ZERO; 3]; 2]);
        let inverse = T::ONE / depth;
        for i in 0..2 {
            let ratio = [s, t][i] / depth;
            let (mut ratio_bar, mut depth_bar) = (T::ZERO, T::ZERO);
            for k in 0..2 {
                let part = T::from_f64(0.5) * inverse * bars[i][k];
                turned_bars[k][i] += part;
                turned_bars[k][2] -= ratio * part;
                ratio_bar -= turned[k][2] * part;
                depth_bar -= here[i][k] * bars[i][k] * inverse;
            }
            bar[i] += ratio_bar * inverse;
            bar[2] += depth_bar - ratio * ratio_bar * inverse;
        }
        let [of_x, of_y] = turned_bars.map(|bars| face.turn_back(bars));
        (face.turn_back(bar), [0, 1, 2].map(|axis| [of_x[axis], of_y[axis]]))
    }

    fn beyond(self, [extent, _]: [usize; 2], face: usize, [row, column]: [isize; 2]) -> Texels {
        let last = extent as isize - 1;
        let (near_row, near_column) = (row.clamp(0, last), column.clamp(0, last));
        if near_row != row && near_column != column {
            // Three faces meet in a corner: there is no fourth texel.
            let texels = [[near_row, near_column], [near_row, column], [row, near_column]];
            let texel = |position| self.beyond([extent; 2], face, position).texels[0];
            return Texels { texels: texels.map(texel), count: 3 };
        }
        if near_row == row && near_column == column {
            return Texels::one([face, row as usize, column as usize]);
        }
        // The texel of the face that the middle of this texel, in the plane of its own face, shows.
        let Place { face, position } = self.locate(towards_texel(face, [row, column], extent));
        let index = |position: f64| ((position * extent as f64) as usize).min(extent - 1);
        Texels::one([face, index(position[1]), index(position[0])])
    }

    #[inline(always)]
    fn ends(self) -> [bool; 2] {
        [false; 2]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cube_faces::direction;

    /// On edges and diagonals of a cube, and at its corners.
    #[test]
    fn of_components_that_are_as_large_the_first_one_has_the_face() {
        let signs = [-1.0, 0.0, 1.0];
        let all = signs.map(|x| signs.map(|y| signs.map(|z| [x, y, z])));
        let mut count = 0;
        for d in all.as_flattened().as_flattened() {
            let Some(axis) = d.iter().position(|&x| x != 0.0) else { continue };
            let face = 2 * axis + usize::from(d[axis] < 0.0);
            assert_eq!(Cube.locate(*d).face, face, "{d:?}");
            assert_eq!(Cube.locate(d.map(|x| 3.0 * x as f32)).face, face, "{d:?}");
            // A hair beside it the larger one has it.
            for other in (0..3).filter(|&other| other != axis && d[other] != 0.0) {
                let mut beside = *d;
                beside[other] *= 1.0 + f64::EPSILON;
                assert_eq!(Cube.locate(beside).face, 2 * other + usize::from(d[other] < 0.0));
            }
            count += 1;
        }
        assert_eq!(count, 26);
    }

    #[test]
    fn a_direction_leads_back_to_its_place() {
        for face in 0..6 {
            for [s, t] in [[0.0, 0.0], [0.75, -0.5], [-0.25, 0.875], [-0.5, -0.125]] {
                let found = Cube.locate(direction(face, [s, t]).map(|x| 2.5 * x));
                assert_eq!(
                    (found.face, found.position),
                    (face, [s, t].map(|ratio| 0.5 * ratio + 0.5))
                );
            }
        }
    }
}
