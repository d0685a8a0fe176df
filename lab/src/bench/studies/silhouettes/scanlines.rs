//! The area-averaged picture by another way: along each of many scanlines visibility is found and
//! colours are integrated exactly, and lines are averaged.
//!
//! Nothing of it is shared with `rasterize`. Along a line each face is a segment whose depth is
//! linear. So what is nearest changes only where a segment starts or ends, or where two segments
//! cross. A colour is a quotient of linear functions, integrated pixel by pixel with three Gauss
//! points.
//!
//! Lines are averaged by one or two Gauss points in each *slab*. A slab lies between heights at which
//! there is a vertex, or an edge passes from one pixel to the next. Within a slab a line's integral
//! is smooth but where something passes behind an edge, or through a face. Slabs are low besides. All
//! of it moves smoothly with the vertices, but where the number of slabs between two heights changes.
//! So differences with a tiny step are derivatives.

use bokashi_core::Tensor;
use bokashi_render_ops::Cull;
use glam::DVec3;

use crate::bench::scenes::Scene;

/// A vertex: x and y in pixels, z / w, 1 / w, colour / w.
type Point = [f64; 7];

/// A face on a line, from its left end on.
#[derive(Debug, Clone, Copy)]
struct Segment {
    left: Point,
    right: Point,
}

impl Segment {
    /// All numbers at x: they are linear.
    fn point_at(&self, x: f64) -> Point {
        let share = (x - self.left[0]) / (self.right[0] - self.left[0]);
        mixed(&self.left, &self.right, share)
    }

    fn depth(&self, x: f64) -> f64 {
        let share = (x - self.left[0]) / (self.right[0] - self.left[0]);
        self.left[2] + share * (self.right[2] - self.left[2])
    }
}

fn mixed(p: &Point, q: &Point, share: f64) -> Point {
    std::array::from_fn(|k| p[k] + share * (q[k] - p[k]))
}

/// How many Gauss points the lines of a slab are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Order {
    One,
    Two,
}

impl Order {
    /// Places between -1 and 1.
    fn nodes(self) -> &'static [f64] {
        match self {
            Self::One => &[0.0],
            Self::Two => &[-0.577_350_269_189_625_8, 0.577_350_269_189_625_8],
        }
    }
}

/// Where edges pass more columns than this, slabs are not cut there: many errors of either sign.
const MOST_CUTS: usize = 100_000;

/// Pictures of a scene, averaged from scanlines.
pub(super) struct Scanlines<'a> {
    pub(super) scene: &'a Scene,
    pub(super) cull: Cull,
    /// Slabs are at most this high, in pixels.
    pub(super) height: f64,
    pub(super) order: Order,
}

impl Scanlines<'_> {
    /// The picture `[H, W, 3]` with vertices at `positions`, all of them before the camera and in the
    /// depth range.
    pub(super) fn picture(&self, positions: &Tensor<f64>) -> Vec<f64> {
        let [width, height] = [self.scene.size.width, self.scene.size.height];
        let points = self.points(positions);
        let row_of = |vertex: u32| points[vertex as usize][1];
        let mut faces: Vec<[u32; 3]> = self.scene.mesh.faces().to_vec();
        faces.retain(|face| self.cull == Cull::None || is_front(face.map(|v| points[v as usize])));
        let top = |face: &[u32; 3]| face.map(row_of).into_iter().fold(f64::INFINITY, f64::min);
        faces.sort_by(|a, b| top(a).total_cmp(&top(b)));
        let mut cuts: Vec<f64> =
            faces.as_flattened().iter().map(|&vertex| row_of(vertex)).collect();
        let columns = || faces.iter().flat_map(|&face| columns_passed(&points, face));
        if columns().take(MOST_CUTS + 1).count() <= MOST_CUTS {
            cuts.extend(columns());
        }
        cuts.retain(|y| (0.0..height as f64).contains(y));
        cuts.extend((0..=height).map(|row| row as f64));
        cuts.sort_by(f64::total_cmp);
        cuts.dedup();
        let mut coming = faces.into_iter().peekable();
        let mut image = vec![0.0; width * height * 3];
        let (mut active, mut segments) = (Vec::new(), Vec::new());
        let mut envelope = Envelope::default();
        for cut in cuts.windows(2) {
            let (from, to) = (cut[0], cut[1]);
            while let Some(face) = coming.next_if(|face| top(face) < to) {
                active.push(face);
            }
            active.retain(|face| face.iter().any(|&vertex| row_of(vertex) > from));
            let slabs = ((to - from) / self.height).ceil() as usize;
            let half = 0.5 * (to - from) / slabs as f64;
            let row = &mut image[from as usize * width * 3..][..width * 3];
            for slab in 0..slabs {
                for node in self.order.nodes() {
                    let y = from + half * ((2 * slab + 1) as f64 + node);
                    segments.clear();
                    segments.extend(active.iter().filter_map(|&face| segment(&points, face, y)));
                    let share = 2.0 * half / self.order.nodes().len() as f64;
                    envelope.find(&segments, width as f64, |segment, from, to| {
                        add(row, segment, from, to, share);
                    });
                }
            }
        }
        image
    }

    fn points(&self, positions: &Tensor<f64>) -> Vec<Point> {
        let Scene { camera, colors, size, .. } = self.scene;
        let vertices = positions.data().as_chunks::<3>().0.iter();
        vertices
            .zip(colors.data().as_chunks::<3>().0)
            .map(|(&position, &[r, g, b])| {
                let clip = *camera * DVec3::from_array(position).extend(1.0);
                let ndc = clip / clip.w;
                let x = (1.0 + ndc.x) * 0.5 * size.width as f64;
                let y = (1.0 - ndc.y) * 0.5 * size.height as f64;
                [x, y, ndc.z, 1.0 / clip.w, r / clip.w, g / clip.w, b / clip.w]
            })
            .collect()
    }
}

/// Whether a face turns its front to the camera: counter-clockwise, where y points up.
fn is_front([p, q, r]: [Point; 3]) -> bool {
    (q[0] - p[0]) * (r[1] - p[1]) < (q[1] - p[1]) * (r[0] - p[0])
}

/// Where a face's edges pass from one column of pixels to the next.
fn columns_passed(points: &[Point], face: [u32; 3]) -> impl Iterator<Item = f64> {
    let corners = face.map(|vertex| points[vertex as usize]);
    [(0, 1), (1, 2), (2, 0)].into_iter().flat_map(move |(a, b)| {
        let (p, q) = (corners[a], corners[b]);
        let (left, right) = if p[0] < q[0] { (p, q) } else { (q, p) };
        (left[0].ceil() as isize..right[0].ceil() as isize).map(move |column| {
            let share = (column as f64 - left[0]) / (right[0] - left[0]);
            left[1] + share * (right[1] - left[1])
        })
    })
}

/// A face on the line y.
fn segment(points: &[Point], face: [u32; 3], y: f64) -> Option<Segment> {
    let mut ends = [[0.0; 7]; 2];
    let mut count = 0;
    for k in 0..3 {
        // From the lower vertex to the higher one, so that neighbours end in the same point.
        let (a, b) = (face[k].min(face[(k + 1) % 3]), face[k].max(face[(k + 1) % 3]));
        let (p, q) = (&points[a as usize], &points[b as usize]);
        if (p[1] <= y) != (q[1] <= y) && count < 2 {
            ends[count] = mixed(p, q, (y - p[1]) / (q[1] - p[1]));
            count += 1;
        }
    }
    ends.sort_by(|p, q| p[0].total_cmp(&q[0]));
    let [left, right] = ends;
    (count == 2 && left[0] < right[0]).then_some(Segment { left, right })
}

/// Adds the integral of a segment's colour from x to another to the pixels of a row.
fn add(row: &mut [f64], segment: &Segment, from: f64, to: f64, share: f64) {
    for column in from as usize..(to.ceil() as usize).min(row.len() / 3) {
        let (a, b) = (from.max(column as f64), to.min(column as f64 + 1.0));
        let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
        for (node, weight) in [(-0.6_f64.sqrt(), 5.0), (0.0, 8.0), (0.6_f64.sqrt(), 5.0)] {
            let [_, _, _, w, r, g, b] = segment.point_at(middle + node * half);
            let share = share * half * weight / 9.0;
            for (sum, color) in row[3 * column..].iter_mut().zip([r, g, b]) {
                *sum += share * color / w;
            }
        }
    }
}

/// What is nearest along a line, and memory.
#[derive(Debug, Default)]
struct Envelope {
    places: Vec<f64>,
    by_start: Vec<usize>,
    active: Vec<usize>,
    /// Stretches that are still to be looked at, the next one last.
    open: Vec<[f64; 2]>,
}

impl Envelope {
    /// Calls `visit(segment, from, to)` for what is nearest between 0 and `width`.
    fn find(&mut self, all: &[Segment], width: f64, mut visit: impl FnMut(&Segment, f64, f64)) {
        let Self { places, by_start, active, open } = self;
        let within = |x: f64| x.clamp(0.0, width);
        places.clear();
        places.extend(all.iter().flat_map(|one| [one.left[0], one.right[0]]).map(within));
        places.sort_by(f64::total_cmp);
        places.dedup();
        by_start.clear();
        by_start.extend(0..all.len());
        by_start.sort_by(|&a, &b| all[a].left[0].total_cmp(&all[b].left[0]));
        active.clear();
        let mut coming = by_start.iter().copied().peekable();
        for pair in places.windows(2) {
            while let Some(index) = coming.next_if(|&index| all[index].left[0] <= pair[0]) {
                active.push(index);
            }
            active.retain(|&index| all[index].right[0] > pair[0]);
            open.push([pair[0], pair[1]]);
            while let Some([from, to]) = open.pop() {
                // The nearest at one end; of those that are as near there, at the other.
                let nearest = |x: f64, other: f64| {
                    let depths = |&index: &usize| [all[index].depth(x), all[index].depth(other)];
                    let order = |a: &usize, b: &usize| depths(a).partial_cmp(&depths(b));
                    active.iter().copied().min_by(|a, b| order(a, b).expect("depths are numbers"))
                };
                let Some((one, other)) = nearest(from, to).zip(nearest(to, from)) else { continue };
                let apart = |x: f64| all[other].depth(x) - all[one].depth(x);
                let (before, after) = (apart(from), apart(to));
                let crossing = from + (to - from) * before / (before - after);
                if one == other || !(from < crossing && crossing < to) {
                    visit(&all[one], from, to);
                    continue;
                }
                let hidden = active
                    .iter()
                    .any(|&index| all[index].depth(crossing) < all[one].depth(crossing) - 1e-12);
                if hidden {
                    open.extend([[crossing, to], [from, crossing]]);
                } else {
                    visit(&all[one], from, crossing);
                    visit(&all[other], crossing, to);
                }
            }
        }
    }
}
