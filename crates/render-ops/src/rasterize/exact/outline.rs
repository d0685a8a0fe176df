//! How much of a pixel a surface covers, whatever is seen of it.
//!
//! # Forward
//! A stretch of an edge of the outline bounds what is covered if no face covers its outer side. Whether a
//! face does changes along the stretch only where another edge of the outline crosses it: beyond any other
//! edge the surface goes on. So stretches are cut where they cross, and the middle of each part tells for
//! all of it. With the covered parts of the pixel's border they run around what is covered, on their left.
//! By Green's theorem the area is `int x dy` around it.
//!
//! # Backward
//! The stretches that are left are the sides: see `polygon`.
//!
//! # Where it says nothing
//! Around what is covered one comes back to where one started, and along the pixel's border covered and
//! free parts take turns. Where rounding has led to anything else the pixel is resolved into what is
//! visible. So it is where faces reach behind the eye or out of the depth range, or where an edge lies on the
//! pixel's border.

use bokashi_core::Scalar;

use super::band_faces::{ALONG_AXIS, BEYOND_DEPTHS, BandFaces, FaceBits, REACH, own_edges};
use super::extent::Extent;
use super::mean::barycentrics;
use super::parts::{Side, Source};
use super::pieces::{Piece, Pieces, Segment};
use super::polygon::{Line, size, value_at};
use super::visible::SMALLEST;
use crate::edge_functions::depth_and_w;
use crate::homogeneous::{Vertex, cross};

/// With more stretches a pixel is resolved into what is visible.
const MOST_STRETCHES: usize = 64;

/// Among as few faces one is found faster by looking at them in turn.
const FEW: usize = 12;

/// Within this share of its size a line's value is rounding.
const ROUNDING: f64 = 1e-14;

/// What is run around ends within this many half pixels of where it started.
const GAP: f64 = 1e-11;

/// A face, around the pixel's centre.
#[derive(Debug, Clone, Copy)]
struct Face<S> {
    band_face: u32,
    vertices: [Vertex<S>; 3],
    /// The edge functions, positive inside.
    edges: [Line<S>; 3],
    /// Bit k: whether edge k is one of the outline, for which this face stands.
    outline: FaceBits,
    /// Bit k: whether such an edge may cross the pixel.
    ends: FaceBits,
}

/// What tells whether a sheet of faces fills the pixel: a face, before it is worked out around the pixel.
#[derive(Debug, Clone, Copy)]
struct SheetFace {
    band_face: u32,
    /// Its number in the mesh.
    number: u32,
    bits: FaceBits,
    /// The search by which it was reached; 0 before that.
    reached_by: u32,
}

/// Where a place lies on the pixel's border, counter-clockwise from its first corner, in half pixels.
type Border<S> = Option<S>;

/// A stretch of an edge of the outline in the pixel, with the face on its left.
#[derive(Debug, Clone, Copy)]
struct Stretch<S> {
    /// The position of its face.
    face: u32,
    k: u8,
    ends: [[S; 2]; 2],
    borders: [Border<S>; 2],
}

/// Where a stretch is crossed, and at which share of its length.
#[derive(Debug, Clone, Copy)]
struct Crossing<S> {
    stretch: u32,
    share: S,
    point: [S; 2],
}

/// What a surface covers of a pixel.
#[derive(Debug, Clone, Copy)]
struct Covered<S> {
    /// In scaled coordinates, in which a pixel has 4.
    area: S,
    /// The position of a face at its rim, and a place there; `None` where there is no rim.
    rim: Option<(usize, [S; 2])>,
}

/// The memory of the search.
#[derive(Debug, Default)]
pub(super) struct Outline<S> {
    faces: Vec<Face<S>>,
    /// The same, in the order of the mesh, and from which to go on.
    sheet: Vec<SheetFace>,
    open: Vec<usize>,
    stretches: Vec<Stretch<S>>,
    crossings: Vec<Crossing<S>>,
    /// Where the rim meets the pixel's border, and whether it comes in there.
    gates: Vec<(S, bool)>,
    /// What bounds the covered part.
    sides: Vec<Side<S>>,
}

impl<S: Scalar<Wide = S>> Outline<S> {
    /// Makes a piece of what `some_faces` cover of a pixel, with its sides; returns whether it could tell.
    /// `face_bits` are of all faces of the band.
    #[inline(always)]
    pub(super) fn run<T: Scalar<Wide = S>>(
        &mut self,
        band: &BandFaces<'_, '_, T>,
        face_bits: &[FaceBits],
        pixel: u32,
        center: [S; 2],
        some_faces: &[u32],
        pieces: &mut Pieces<S>,
    ) -> bool {
        let Some(Covered { area, rim }) = self.find(band, face_bits, center, some_faces) else {
            return false;
        };
        // Without a rim the pixel is what its centre is.
        let Some((face, point)) = rim else { return true };
        pieces.pixels.push(pixel);
        if area > S::from_f64(4.0 * SMALLEST) {
            let Face { band_face, edges, .. } = self.faces[face];
            let corners = band.view.corners_of(band.faces[band_face as usize] as usize);
            let extent = Extent::from_point(point);
            let barycentrics = barycentrics(&edges, corners.map(|corner| corner.factor), &extent);
            pieces.pieces.push(Piece { band_face, area, extent, moves: false, barycentrics });
            if band.view.needs {
                let segments = self.sides.iter().map(|&side| Segment { piece: 0, side });
                pieces.segments.extend(segments);
            }
        } else {
            pieces.dropped += 1;
        }
        pieces.ends.push(pieces.pieces.len() as u32);
        if band.view.needs {
            pieces.segment_ends.push(pieces.segments.len() as u32);
        }
        true
    }

    /// What `some_faces` cover of the pixel around `center`, and its sides.
    #[inline(always)]
    fn find<T: Scalar<Wide = S>>(
        &mut self,
        band: &BandFaces<'_, '_, T>,
        face_bits: &[FaceBits],
        center: [S; 2],
        some_faces: &[u32],
    ) -> Option<Covered<S>> {
        let mut bits = 0;
        self.sheet.clear();
        self.sheet.extend(some_faces.iter().map(|&band_face| {
            let (number, bits_here) =
                (band.faces[band_face as usize], face_bits[band_face as usize]);
            bits |= bits_here;
            SheetFace { band_face, number, bits: bits_here, reached_by: 0 }
        }));
        let is_left_out = |face: &SheetFace| {
            face.bits >> BEYOND_DEPTHS != 0
                || band.on_border(face.band_face, face.bits >> ALONG_AXIS, center) != 0
        };
        if bits >> ALONG_AXIS != 0 && self.sheet.iter().any(is_left_out) {
            return None;
        }
        if self.is_filled(band, center) {
            return Some(Covered { area: S::from_f64(4.0), rim: None });
        }
        self.faces.clear();
        self.faces.extend(
            self.sheet.iter().map(|face| Face::new(band, face.band_face, face.bits, center)),
        );
        self.stretches.clear();
        for (index, face) in (0..).zip(&self.faces) {
            let ending = (0..3).filter(|k| face.ends >> k & 1 == 1);
            self.stretches.extend(ending.filter_map(|k| face.stretch(index, k)));
        }
        if self.stretches.len() > MOST_STRETCHES {
            return None;
        }
        // What a face has on both sides bounds nothing, and nothing changes where others cross it.
        let faces = &self.faces;
        self.stretches.retain(|stretch| {
            let mut others = others(faces, stretch);
            !others.any(|face| face.surrounds(stretch.ends))
        });
        self.find_crossings();
        self.covered()
    }

    /// Whether a sheet of faces surely fills the pixel. One of them covers its centre. From there the sheet goes on
    /// across each edge that may cross the pixel, and none of these is of the outline.
    #[inline(always)]
    fn is_filled<T: Scalar<Wide = S>>(
        &mut self,
        band: &BandFaces<'_, '_, T>,
        [x, y]: [S; 2],
    ) -> bool {
        let Self { sheet, open, .. } = self;
        let adjacency = band.view.mesh.adjacency();
        // By coefficients that are at hand: `REACH` is more than they are off by.
        let edges = |face: SheetFace| {
            let edges = band.weights[face.band_face as usize].edges;
            edges.map(|[one, by_x, by_y]| [one + by_x * x + by_y * y, by_x, by_y])
        };
        let margin = S::from_f64(REACH - 1.0);
        let covers_center = |face: SheetFace| {
            let [a, b, c] = edges(face).map(|[one, x, y]| one > margin * (x.abs() + y.abs()));
            a & b & c
        };
        for (first, search) in (0..sheet.len()).zip(1..) {
            // A sheet is looked for from a face at the centre: no other sheet fills the pixel.
            if sheet[first].reached_by != 0 || !covers_center(sheet[first]) {
                continue;
            }
            let mut has_border = false;
            sheet[first].reached_by = search;
            open.clear();
            open.push(first);
            while let Some(face) = open.pop().map(|index| sheet[index]) {
                let crossing = crossing(&edges(face));
                has_border |= crossing & face.bits != 0;
                if has_border {
                    break;
                }
                for corner in (0..3).filter(|corner| crossing >> corner & 1 == 1) {
                    let neighbor = adjacency.neighbor(face.number as usize, corner);
                    // A face that does not reach into the pixel is none of its faces.
                    let Some(index) = neighbor.and_then(|other| place_of(sheet, other.face)) else {
                        continue;
                    };
                    match sheet[index].reached_by {
                        0 => {
                            sheet[index].reached_by = search;
                            open.push(index);
                        }
                        // An earlier search of the same sheet has ended at a border.
                        other => has_border |= other != search,
                    }
                }
            }
            if !has_border {
                return true;
            }
        }
        false
    }

    /// Finds where stretches cross, sorted along each of them.
    fn find_crossings(&mut self) {
        let Self { stretches, crossings, .. } = self;
        crossings.clear();
        for (index, one) in stretches.iter().enumerate() {
            for (other_index, other) in stretches.iter().enumerate().skip(index + 1) {
                let along = |stretch: &Stretch<S>| {
                    let [p, q] = stretch.ends;
                    [q[0] - p[0], q[1] - p[1]]
                };
                let (direction, others) = (along(one), along(other));
                let between =
                    [other.ends[0][0] - one.ends[0][0], other.ends[0][1] - one.ends[0][1]];
                let angle = cross(direction, others);
                // They meet where `p + s direction = p' + t others`: the cross product with a direction leaves one
                // unknown.
                let shares = [cross(between, others) / angle, cross(between, direction) / angle];
                // Of parallel stretches no share is a number within the range.
                if shares.iter().all(|&share| share > S::ZERO && share < S::ONE) {
                    let point = [0, 1].map(|axis| one.ends[0][axis] + shares[0] * direction[axis]);
                    let pair = [index, other_index].into_iter().zip(shares);
                    crossings.extend(pair.map(|(index, share)| Crossing {
                        stretch: index as u32,
                        share,
                        point,
                    }));
                }
            }
        }
        crossings.sort_unstable_by(|a, b| {
            a.stretch.cmp(&b.stretch).then(a.share.to_f64().total_cmp(&b.share.to_f64()))
        });
    }

    /// Keeps what bounds the covered part, and sums up its area.
    fn covered(&mut self) -> Option<Covered<S>> {
        let Self { faces, stretches, crossings, gates, sides, .. } = self;
        gates.clear();
        sides.clear();
        let (mut area, mut gap) = (S::ZERO, [S::ZERO; 2]);
        let mut rim: Option<(S, usize, [S; 2])> = None;
        let mut crossings = &crossings[..];
        for (index, stretch) in (0..).zip(&*stretches) {
            let count = crossings.iter().take_while(|crossing| crossing.stretch == index).count();
            let of_stretch;
            (of_stretch, crossings) = crossings.split_at(count);
            let places = || of_stretch.iter().map(|crossing| (crossing.point, None));
            let [start, end] = [0, 1].map(|k| (stretch.ends[k], stretch.borders[k]));
            let starts = std::iter::once(start).chain(places());
            let ends = places().chain(std::iter::once(end));
            for ((p, from), (q, to)) in starts.zip(ends) {
                let half = S::from_f64(0.5);
                let middle = [half * (p[0] + q[0]), half * (p[1] + q[1])];
                if !is_rim(faces, stretch, middle) {
                    continue;
                }
                // int x dy along a straight part: x at its middle times dy, exactly.
                area += middle[0] * (q[1] - p[1]);
                // A way that closes ends where it began: the sum of all its steps is 0.
                gap = [gap[0] + q[0] - p[0], gap[1] + q[1] - p[1]];
                gates.extend(from.map(|position| (position, true)));
                gates.extend(to.map(|position| (position, false)));
                let length = (q[0] - p[0]).abs() + (q[1] - p[1]).abs();
                if rim.is_none_or(|(longest, ..)| length > longest) {
                    rim = Some((length, stretch.face as usize, middle));
                }
                let face = &faces[stretch.face as usize];
                let [_, x, y] = face.edges[usize::from(stretch.k)];
                sides.push(Side {
                    source: Source::Edge { band_face: face.band_face, k: stretch.k },
                    is_inside: true,
                    is_on_border: false,
                    normal: [x, y],
                    ends: [p, q],
                });
            }
        }
        let covers_corner = || faces.iter().any(|face| face.covers([-S::ONE; 2]));
        let closes = add_borders(gates, covers_corner, &mut area, &mut gap)?;
        let most = S::from_f64(GAP);
        let is_whole = closes && gap[0].abs() < most && gap[1].abs() < most;
        let rim = rim.map(|(_, face, point)| (face, point));
        is_whole.then_some(Covered { area, rim })
    }
}

/// Adds the covered parts of the pixel's border, which begin where the rim leaves the pixel and end where it
/// comes in. Without gates all of it is covered, or nothing. Returns whether the last part ends; `None` where
/// the rim leaves twice, or comes in twice, in a row.
fn add_borders<S: Scalar>(
    gates: &mut [(S, bool)],
    covers_corner: impl Fn() -> bool,
    area: &mut S,
    gap: &mut [S; 2],
) -> Option<bool> {
    gates.sort_unstable_by(|a, b| a.0.to_f64().total_cmp(&b.0.to_f64()));
    // Where the rim leaves the pixel, what follows of the border is covered.
    let is_open = match gates.last() {
        Some(&(_, comes_in)) => !comes_in,
        None => covers_corner(),
    };
    let mut from = is_open.then_some(S::ZERO);
    let end = (S::from_f64(8.0), true);
    for &(position, comes_in) in gates.iter().chain(is_open.then_some(&end)) {
        match (from, comes_in) {
            (Some(start), true) => {
                add_border([start, position], area, gap);
                from = None;
            }
            (None, false) => from = Some(position),
            _ => return None,
        }
    }
    Some(from.is_none())
}

/// Adds what goes along the pixel's border between two places to the integral of x dy and to the way.
fn add_border<S: Scalar>([from, to]: [S; 2], area: &mut S, gap: &mut [S; 2]) {
    for (side, [dx, dy]) in
        [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]].into_iter().enumerate()
    {
        let first = S::from_f64(2.0 * side as f64);
        let last = first + S::from_f64(2.0);
        let length = to.minimum_or_nan(last) - from.maximum_or_nan(first);
        if length > S::ZERO {
            *gap = [gap[0] + S::from_f64(dx) * length, gap[1] + S::from_f64(dy) * length];
            // x is 1 where y grows, and -1 where it falls.
            *area += S::from_f64(dy * dy) * length;
        }
    }
}

/// The faces but that of a stretch.
#[inline(always)]
fn others<'a, S>(faces: &'a [Face<S>], stretch: &Stretch<S>) -> impl Iterator<Item = &'a Face<S>> {
    let face = stretch.face as usize;
    faces[..face].iter().chain(&faces[face + 1..])
}

/// Whether no face covers the outer side of a stretch at its point `middle`, and no other stretch along it
/// counts there: that of the nearest face does, or of the lowest one.
#[inline(always)]
fn is_rim<S: Scalar>(faces: &[Face<S>], stretch: &Stretch<S>, middle: [S; 2]) -> bool {
    let owner = &faces[stretch.face as usize];
    let [_, x, y] = owner.edges[usize::from(stretch.k)];
    others(faces, stretch).all(|face| {
        let mut is_beyond = true;
        let mut is_along = false;
        for (k, &edge) in face.edges.iter().enumerate() {
            let value = value_at(edge, middle);
            let rounding = S::from_f64(ROUNDING) * size(edge);
            if value > rounding {
                continue;
            }
            if value < -rounding {
                return true;
            }
            // The face begins or ends here.
            if edge[1] * x + edge[2] * y > S::ZERO {
                is_beyond = false;
                is_along |= face.outline >> k & 1 == 1;
            }
        }
        !is_beyond && (!is_along || !face.is_before(owner, middle))
    })
}

impl<S: Scalar<Wide = S>> Face<S> {
    #[inline(always)]
    fn new<T: Scalar<Wide = S>>(
        band: &BandFaces<'_, '_, T>,
        band_face: u32,
        bits: FaceBits,
        center: [S; 2],
    ) -> Self {
        let corners = band.view.corners_of(band.faces[band_face as usize] as usize);
        let vertices = corners.map(|corner| corner.vertex.around(center));
        let edges = band.edges_around(band_face, vertices.map(|vertex| [vertex.x, vertex.y]));
        let outline = own_edges(bits);
        Self { band_face, vertices, edges, outline, ends: outline & crossing(&edges) }
    }
}

/// The place of the face of this number among the faces of a pixel.
#[inline(always)]
fn place_of(sheet: &[SheetFace], number: u32) -> Option<usize> {
    if sheet.len() <= FEW {
        return sheet.iter().position(|face| face.number == number);
    }
    sheet.binary_search_by_key(&number, |face| face.number).ok()
}

/// Which lines of a face's edges may cross the pixel: a bit for each.
#[inline(always)]
fn crossing<S: Scalar>(edges: &[Line<S>; 3]) -> FaceBits {
    let bit = |k: usize| {
        let [one, x, y] = edges[k];
        let reach = S::from_f64(REACH) * (x.abs() + y.abs());
        FaceBits::from(one.abs() <= reach) << k
    };
    bit(0) | bit(1) | bit(2)
}

impl<S: Scalar> Face<S> {
    /// What lies in the pixel of an edge.
    #[inline(always)]
    fn stretch(&self, face: u32, k: usize) -> Option<Stretch<S>> {
        let [one, x, y] = self.edges[k];
        let [p, q] = [1, 2].map(|next| {
            let Vertex { x, y, w, .. } = self.vertices[(k + next) % 3];
            [x / w, y / w]
        });
        // Along the line the face lies on the left.
        let is_reversed = (q[0] - p[0]) * y < (q[1] - p[1]) * x;
        let [p, q] = if is_reversed { [q, p] } else { [p, q] };
        let mut shares = [S::ZERO, S::ONE];
        let mut cut_by = [None, None];
        for axis in 0..2 {
            for sign in [-S::ONE, S::ONE] {
                // The pixel is where the distance to this side of its border is positive.
                let [from, to] = [p, q].map(|point| S::ONE - sign * point[axis]);
                if from <= S::ZERO && to <= S::ZERO {
                    return None;
                }
                let share = from / (from - to);
                if from < S::ZERO && share > shares[0] {
                    (shares[0], cut_by[0]) = (share, Some((axis, sign)));
                }
                if to < S::ZERO && share < shares[1] {
                    (shares[1], cut_by[1]) = (share, Some((axis, sign)));
                }
            }
        }
        if shares[0] >= shares[1] {
            return None;
        }
        let mut ends = [p, q];
        let mut borders = [None, None];
        for end in 0..2 {
            if let Some((axis, sign)) = cut_by[end] {
                let along = 1 - axis;
                // From the line, not from the share: an end of the edge may be far away, and what is rounded
                // there must not lead off the line by more than `ROUNDING`.
                let normal = [x, y];
                let coordinate = -(one + normal[axis] * sign) / normal[along];
                let coordinate = coordinate.maximum_or_nan(-S::ONE).minimum_or_nan(S::ONE);
                ends[end][along] = coordinate;
                ends[end][axis] = sign;
                // Sides of the border, counter-clockwise from y = -1.
                let (first, turns) = match (axis, sign > S::ZERO) {
                    (1, false) => (1.0, 1.0),
                    (0, true) => (3.0, 1.0),
                    (1, true) => (5.0, -1.0),
                    _ => (7.0, -1.0),
                };
                borders[end] = Some(S::from_f64(first) + S::from_f64(turns) * coordinate);
            }
        }
        Some(Stretch { face, k: k as u8, ends, borders })
    }

    /// Whether a stretch with these ends surely lies in it, and not on its edges.
    #[inline(always)]
    fn surrounds(&self, [p, q]: [[S; 2]; 2]) -> bool {
        self.edges.iter().all(|&edge| {
            let rounding = S::from_f64(ROUNDING) * size(edge);
            value_at(edge, p) > rounding && value_at(edge, q) > rounding
        })
    }

    /// Whether a point lies in it or on its edges.
    fn covers(&self, point: [S; 2]) -> bool {
        self.edges.iter().all(|&edge| value_at(edge, point) >= S::ZERO)
    }

    /// Whether at a point it is nearer than another face; where both are as near, the lower face is.
    fn is_before(&self, other: &Self, point: [S; 2]) -> bool {
        let depth = |face: &Self| {
            let [depth, _] =
                depth_and_w(&face.vertices, face.edges.map(|edge| value_at(edge, point)));
            depth
        };
        let (this, others) = (depth(self), depth(other));
        this < others || this == others && self.band_face < other.band_face
    }
}
