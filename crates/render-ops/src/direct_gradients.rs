//! From the gradients of interpolated values to those of vertices, past those of the barycentrics.
//!
//! Where nobody asks for the gradients of u and v, no fragment at a pixel centre needs any. `rasterize` would sum
//! over a face's fragments `S_ij = sum b_i (b_bar_j - m)` (see `rasterize::pull_back`), with `m = sum_j b_bar_j b_j`,
//! `b_bar_0 = sum_c s_bar_c (A_0c - A_2c)`, `b_bar_1 = sum_c s_bar_c (A_1c - A_2c)` and `b_bar_2 = 0`. The attributes'
//! own gradients are the sums `G_ci = sum b_i s_bar_c`. With these and `M_i = sum b_i m`:
//! `S_i0 = sum_c G_ci (A_0c - A_2c) - M_i`, `S_i1 = sum_c G_ci (A_1c - A_2c) - M_i`, `S_i2 = -M_i`.
//! So twelve sums of a face give both gradients. What follows from the sums is worked out for some faces side by
//! side.
//!
//! Where the third weight of some face loses digits, `rasterize` goes its way with all of them. Faces whose sums leave
//! the range of the numbers are left to it, too.

use std::ops::Range;

use bokashi_core::{Accumulator, Scalar};

use crate::coverage::Coverage;
use crate::dispatch::dispatch;
use crate::edge_functions::{LocalFace, are_even, has_even_vertices};
use crate::homogeneous::Vertex;
use crate::mesh::Mesh;
use crate::scratch::Workbench;
use crate::size::Size;
use crate::weighted_sums::{FragmentPlanes, Terms};

/// What the gradients of three channels at the centres of pixels lead to.
pub(crate) struct DirectGradients<'a, T> {
    pub(crate) coverage: &'a Coverage,
    /// The vertices that have the attributes.
    pub(crate) indices: &'a Mesh,
    pub(crate) attributes: &'a [[T; 3]],
    pub(crate) barycentrics: &'a [[T; 2]],
    pub(crate) clip: &'a [[T; 4]],
    /// The gradients of the values.
    pub(crate) s_bar: &'a [[T; 3]],
}

/// Lists of the gradients of faces' vertices, where bands are worked on at the same time.
pub(crate) type FaceLists<T> = Workbench<Vec<Option<FaceBars<T>>>>;

/// The gradients of a face's vertices.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FaceBars<T> {
    /// Of x, y and w.
    clip: [[T; 3]; 3],
    attributes: [[T; 3]; 3],
}

/// Per vertex i: the sums `G_ci` of each channel c, and `M_i`.
type Sums<S> = [[S; 4]; 3];

/// `A_0 - A_2` and `A_1 - A_2`.
type Slopes<S> = [[S; 3]; 2];

impl<T: Scalar> DirectGradients<'_, T> {
    /// Whether the third weight of every face has its digits, and no vertex is so far or near that it is multiplied.
    pub(crate) fn has_even_weights(&self) -> bool {
        let Coverage { mesh, size, centers, .. } = self.coverage;
        let vertex = |[x, y, _, w]: [T; 4]| Vertex::unscaled([x, y, w], *size);
        // Mostly it holds for any three vertices, which are read faster in their order.
        are_even(self.clip.iter().map(|&clip| vertex(clip)), *size)
            || centers.slots.iter().all(|slot| {
                let face = mesh.faces()[slot.face as usize];
                are_even(face.map(|index| vertex(self.clip[index as usize])), *size)
            })
    }

    /// Adds to the gradients of the clip positions, `[V, 4]`, and where it is wanted to that of the attributes, which has
    /// the bits that it has alone. Where a face is left out, `add_attributes(entries, slot)` adds to the latter. Returns
    /// the slots of these faces.
    pub(crate) fn add_to(
        &self,
        clip_bar: &mut Accumulator<T>,
        attributes_bar: Option<&mut Accumulator<T>>,
        lists: &FaceLists<T>,
        add_attributes: impl Fn(&mut [T], usize) + Send,
    ) -> Vec<usize> {
        let mut sums = VertexSums {
            direct: self,
            clip_bar: clip_bar.entries().as_chunks_mut::<4>().0,
            attributes_bar: attributes_bar.map(|bar| bar.entries().as_chunks_mut::<3>().0),
            add_attributes,
            left_out: Vec::new(),
        };
        let centers = &self.coverage.centers;
        if centers.is_shared() {
            let work = |slots: Range<usize>, _: usize, _: &mut [T]| {
                let mut all_bars = lists.take();
                all_bars.clear();
                self.walk(
                    slots.clone(),
                    #[inline(always)]
                    |_, bars| all_bars.push(bars),
                );
                (slots, all_bars)
            };
            centers.merge_bands_mut(0, &mut [], work, |(slots, all_bars)| {
                slots.zip(&all_bars).for_each(|(slot, bars)| sums.add(slot, *bars));
                lists.put_back(all_bars);
            });
        } else {
            self.walk(
                0..centers.slots.len(),
                #[inline(always)]
                |slot, bars| sums.add(slot, bars),
            );
        }
        sums.left_out
    }

    /// Calls `emit` with each of `slots` and the gradients of its face's vertices.
    fn walk(&self, slots: Range<usize>, emit: impl FnMut(usize, Option<FaceBars<T>>)) {
        dispatch::<T, _>(Walk { direct: self, slots, emit });
    }

    /// Puts what the gradients of the face of `slot` follow from into a lane.
    #[inline(always)]
    fn put(
        &self,
        planes: &mut FragmentPlanes<'_, T, 3>,
        group: &mut Group<T>,
        lane: usize,
        slot: usize,
    ) {
        let Coverage { mesh, centers, .. } = self.coverage;
        let face = centers.face(slot);
        let vertices = mesh.faces()[face].map(|vertex| self.clip[vertex as usize]);
        put(&mut group.vertices, lane, vertices.map(|[x, y, _, w]| [x, y, w]));
        let corners =
            self.indices.faces()[face].map(|vertex| self.attributes[vertex as usize].map(T::widen));
        let slopes = [0, 1].map(|k| [0, 1, 2].map(|c| corners[k][c] - corners[2][c]));
        group.first_pixels[lane] = centers.first_pixel_of(slot) as u32;
        put(&mut group.slopes, lane, slopes);
        let fragments = centers.fragments_of(slot..slot + 1);
        group.sums_of_faces[lane] = planes.sum(&slopes, fragments);
    }
}

/// The gradients that those of faces are added to.
struct VertexSums<'a, 'b, T, A> {
    direct: &'a DirectGradients<'b, T>,
    clip_bar: &'a mut [[T; 4]],
    attributes_bar: Option<&'a mut [[T; 3]]>,
    /// See [`DirectGradients::add_to`].
    add_attributes: A,
    left_out: Vec<usize>,
}

impl<T: Scalar, A: Fn(&mut [T], usize)> VertexSums<'_, '_, T, A> {
    /// Adds those of the face of `slot`, or leaves it out.
    #[inline(always)]
    fn add(&mut self, slot: usize, bars: Option<FaceBars<T>>) {
        let Self { direct, clip_bar, attributes_bar, add_attributes, left_out } = self;
        let Some(bars) = bars else {
            if let Some(attributes_bar) = attributes_bar {
                add_attributes(attributes_bar.as_flattened_mut(), slot);
            }
            return left_out.push(slot);
        };
        let face = direct.coverage.centers.face(slot);
        // Not by `map`, which would be a call.
        let [p, q, r] = bars.clip;
        let row = |[x, y, w]: [T; 3]| [x, y, T::ZERO, w];
        add_rows(clip_bar, direct.coverage.mesh().faces()[face], &[row(p), row(q), row(r)]);
        if let Some(attributes_bar) = attributes_bar {
            add_rows(attributes_bar, direct.indices.faces()[face], &bars.attributes);
        }
    }
}

/// `s_bar`, and m.
impl<S: Scalar> Terms<S, 3, 4> for Slopes<S> {
    #[inline(always)]
    fn compute(&self, [u, v]: [S; 2], [r, g, b]: [S; 3]) -> [S; 4] {
        let [by_u, by_v] = self;
        let u_bar = r * by_u[0] + g * by_u[1] + b * by_u[2];
        let v_bar = r * by_v[0] + g * by_v[1] + b * by_v[2];
        [r, g, b, u * u_bar + v * v_bar]
    }
}

/// The work of a walk: not as a closure, which would not be compiled for the vectors that were found.
struct Walk<'a, 'b, T, E> {
    direct: &'a DirectGradients<'b, T>,
    slots: Range<usize>,
    emit: E,
}

impl<T: Scalar, E: FnMut(usize, Option<FaceBars<T>>)> pulp::WithSimd for Walk<'_, '_, T, E> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: pulp::Simd>(self, _: V) {
        let Self { direct, slots, mut emit } = self;
        let mut group = Group::new();
        let mut planes = FragmentPlanes::new(direct.barycentrics, direct.s_bar);
        let Range { start: mut first, end } = slots;
        while first < end {
            let count = LANES.min(end - first);
            for lane in 0..count {
                direct.put(&mut planes, &mut group, lane, first + lane);
            }
            group.work_out(direct.coverage.size);
            for lane in 0..count {
                emit(first + lane, group.bars(lane));
            }
            first += LANES;
        }
    }
}

/// Faces that are worked on side by side.
const LANES: usize = 8;

type Lanes<S> = [S; LANES];

/// Faces, number by number.
struct Group<T: Scalar> {
    /// x, y and w in clip space.
    vertices: [[Lanes<T>; 3]; 3],
    /// The face's first pixel.
    first_pixels: Lanes<u32>,
    slopes: [[Lanes<T::Wide>; 3]; 2],
    sums: [[Lanes<T::Wide>; 4]; 3],
    /// The same numbers, face by face: put into lanes one by one, they would not be summed in vectors.
    sums_of_faces: [Sums<T::Wide>; LANES],
    /// The gradients of x, y and w, and of the attributes.
    bars: [[Lanes<T>; 3]; 3],
    attribute_bars: [[Lanes<T>; 3]; 3],
    /// Whether the third weight has its digits.
    are_even: Lanes<bool>,
    /// 0 where all gradients of the face are finite, and NaN otherwise.
    zeros: Lanes<T>,
}

impl<T: Scalar> Group<T> {
    fn new() -> Self {
        let (zero, wide) = ([T::ZERO; LANES], [T::Wide::ZERO; LANES]);
        let [vertices, bars, attribute_bars] = [[[zero; 3]; 3]; 3];
        let (first_pixels, slopes, sums) = ([0; LANES], [[wide; 3]; 2], [[wide; 4]; 3]);
        let sums_of_faces = [[[T::Wide::ZERO; 4]; 3]; LANES];
        let (are_even, zeros) = ([false; LANES], zero);
        Self {
            vertices,
            first_pixels,
            slopes,
            sums,
            sums_of_faces,
            bars,
            attribute_bars,
            are_even,
            zeros,
        }
    }

    /// From the sums to the gradients.
    #[inline(always)]
    fn work_out(&mut self, size: Size) {
        let Self { vertices, first_pixels, slopes, sums, sums_of_faces, .. } = self;
        let Self { bars, attribute_bars, are_even, zeros, .. } = self;
        for lane in 0..LANES {
            put(sums, lane, sums_of_faces[lane]);
        }
        for lane in 0..LANES {
            let vertices = vertices.each_ref().map(|[x, y, w]| {
                Vertex::unscaled([x, y, w].map(|number| number[lane].widen()), size)
            });
            let origin = size.center_in_lanes(first_pixels[lane]);
            let face = LocalFace::around(vertices, [T::Wide::ONE; 3], origin);
            let scale = -T::Wide::ONE / face.determinant();
            are_even[lane] = has_even_vertices(&vertices, size);
            for i in 0..3 {
                let m = sums[i][3][lane];
                let along = |k: usize| {
                    let by: [T::Wide; 3] = [0, 1, 2].map(|c| sums[i][c][lane] * slopes[k][c][lane]);
                    by[0] + by[1] + by[2] - m
                };
                let of_vertex = face.along_edges([along(0), along(1), -m], size);
                for k in 0..3 {
                    bars[i][k][lane] = T::narrow(scale * of_vertex[k]);
                }
            }
        }
        // 0 x is 0 for a finite x, and NaN for others: so a sum asks for all of them without comparisons. In a loop of its
        // own, so that both loops become vectors.
        for lane in 0..LANES {
            let mut zero = T::ZERO;
            for i in 0..3 {
                for c in 0..3 {
                    let bar = T::narrow(sums[i][c][lane]);
                    attribute_bars[i][c][lane] = bar;
                    zero += T::ZERO * bars[i][c][lane] + T::ZERO * bar;
                }
            }
            zeros[lane] = zero;
        }
    }

    /// The gradients of the face in a lane; `None` where `rasterize` takes more care.
    #[inline(always)]
    fn bars(&self, lane: usize) -> Option<FaceBars<T>> {
        let of_lane = |bars: &[[Lanes<T>; 3]; 3]| {
            bars.each_ref().map(|row| row.each_ref().map(|bar| bar[lane]))
        };
        let (clip, attributes) = (of_lane(&self.bars), of_lane(&self.attribute_bars));
        let is_plain = self.are_even[lane] & self.zeros[lane].is_finite();
        is_plain.then_some(FaceBars { clip, attributes })
    }
}

/// Puts the numbers of a face into a lane.
#[inline(always)]
fn put<S: Copy, const N: usize, const M: usize>(
    lanes: &mut [[Lanes<S>; N]; M],
    lane: usize,
    numbers: [[S; N]; M],
) {
    for (lanes, &number) in lanes.as_flattened_mut().iter_mut().zip(numbers.as_flattened()) {
        lanes[lane] = number;
    }
}

/// Adds the rows of a face's vertices.
#[inline(always)]
fn add_rows<T: Scalar, const N: usize>(entries: &mut [[T; N]], face: [u32; 3], rows: &[[T; N]; 3]) {
    for (vertex, row) in face.into_iter().zip(rows) {
        let entries = &mut entries[vertex as usize];
        *entries = std::array::from_fn(|k| entries[k] + row[k]);
    }
}
