//! Laws of sides that lie on pixel borders: their derivative is the central one.

use super::exact::{exact, picture};
use super::*;
use bokashi_core::Var;
use bokashi_render_ops::{Background, Mesh, Size, composite, interpolate, rasterize};

/// Corners of a rectangle between the places `low` and `high` in pixels, at a depth; faces go over
/// the first three corners and the last three.
fn rectangle(low: [f64; 2], high: [f64; 2], depth: f64, size: Size) -> Clip {
    let corners = [[low[0], low[1]], [high[0], low[1]], [low[0], high[1]], [high[0], high[1]]];
    corners
        .map(|[x, y]| {
            let (x, y) = (2.0 * x / size.width as f64 - 1.0, 1.0 - 2.0 * y / size.height as f64);
            [x, y, depth, 1.0]
        })
        .into()
}

/// The derivative of a loss of the picture, white on black, as vertices move by `along`.
fn slope<T: Scalar>(
    clip: &Clip,
    along: &Clip,
    faces: &[[u32; 3]],
    size: Size,
    loss: impl for<'t> Fn(Var<'t, T>) -> Var<'t, T>,
) -> f64 {
    let tape = Tape::<T>::new();
    let positions = tape.leaf(&tensor(clip));
    let mesh = Mesh::new(faces.to_vec(), clip.len()).unwrap();
    let fragments = rasterize(positions, &mesh, exact(size).creases(&[])).unwrap();
    let white = tape.constant(&Tensor::full([clip.len(), 1], T::ONE));
    let surface = interpolate(white, &fragments).unwrap();
    let picture = composite(surface, &fragments, Background::Zero).unwrap();
    let loss = loss(picture.image().unwrap());
    let gradient = loss.backward().unwrap().get_or_zeros(positions);
    let terms = gradient.data().iter().zip(along.as_flattened());
    terms.map(|(bar, along)| bar.to_f64() * along).sum()
}

fn a_side_on_a_border_counts_half_in_each_pixel_in<T: Scalar>() {
    let size = Size::square(16);
    let faces = [[0, 1, 2], [1, 2, 3]];
    let along =
        rectangle([0.0; 2], [16.0; 2], 0.0, size).iter().map(|p| [p[0], p[1], 0.0, 0.0]).collect();
    // Sums of squares move with the pixels inside twice as fast, and with those outside not at all.
    for (low, high, expected) in [(4.0, 12.0, 256.0), (1.0, 15.0, 448.0), (0.0, 16.0, 256.0)] {
        let clip = rectangle([low; 2], [high; 2], 0.0, size);
        let squares = slope::<T>(&clip, &along, &faces, size, |image| image.square().sum());
        // Of the whole image there are the pixels inside alone.
        let share = if low == 0.0 { 2.0 } else { 1.0 };
        assert!((squares - share * expected).abs() < 1e-3, "{low} {high}: {squares}");
        let sum = slope::<T>(&clip, &along, &faces, size, |image| image.sum());
        assert!((sum - expected).abs() < 1e-3, "{low} {high}: {sum}");
    }
    // The base of a triangle moves up: half of it is lost below its apex.
    let clip = vec![[-0.5, -0.5, 0.0, 1.0], [0.5, -0.5, 0.0, 1.0], [0.0, 0.5, 0.0, 1.0]];
    let along = vec![[0.0, 1.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0; 4]];
    let sum = slope::<T>(&clip, &along, &[[0, 1, 2]], size, |image| image.sum());
    assert!((sum + 32.0).abs() < 1e-4, "{sum}");
}

#[test]
fn a_side_on_a_border_counts_half_in_each_pixel() {
    a_side_on_a_border_counts_half_in_each_pixel_in::<f64>();
    a_side_on_a_border_counts_half_in_each_pixel_in::<f32>();
}

/// What has no area in a pixel is not seen there.
#[test]
fn faces_beside_their_pixels_are_not_seen() {
    let size = Size::square(4);
    let clip = rectangle([1.0; 2], [3.0; 2], 0.0, size);
    let tape = Tape::<f64>::new();
    let mesh = Mesh::new(vec![[0, 1, 2], [1, 2, 3]], 4).unwrap();
    let fragments = rasterize(tape.leaf(&tensor(&clip)), &mesh, exact(size).creases(&[])).unwrap();
    let coverage = &fragments.coverage;
    let inside = |pixel: usize| (1..3).contains(&(pixel % 4)) && (1..3).contains(&(pixel / 4));
    for (pixel, id) in coverage.triangle_ids().into_iter().enumerate() {
        assert_eq!(id > 0, inside(pixel), "{pixel}");
        assert_eq!(coverage.fragment_at(pixel).is_some(), inside(pixel));
    }
    let weights = fragments.weight.unwrap().value();
    assert_eq!(weights.data().iter().sum::<f64>() + coverage.centers() as f64, 4.0);
    assert!(coverage.boundary_counts().pieces > 4);
}

/// A scene with its colours.
#[derive(Debug, Clone)]
struct Scene {
    size: Size,
    clip: Clip,
    colors: Vec<f64>,
    faces: Vec<[u32; 3]>,
    upstream: u64,
    /// Whether colours are those of faces, and w differs.
    is_flat: bool,
}

impl Scene {
    fn mesh(&self) -> Mesh {
        // Inner edges are seams: where a pixel shows its centre, it leaps once an edge crosses it.
        Mesh::new(self.faces.clone(), self.clip.len()).unwrap().with_seams(|_, _| true)
    }

    fn upstream(&self) -> Tensor<f64> {
        let hash = |k: usize| (k as u64 + 1).wrapping_mul(self.upstream | 1) >> 11;
        let number = |k| hash(k) as f64 / (1_u64 << 53) as f64 - 0.4;
        Tensor::from_flat_fn([self.size.height, self.size.width, 2], number)
    }

    fn loss(&self, clip: &Clip) -> f64 {
        let tape = Tape::<f64>::new();
        let colors = tape.constant(&Tensor::new([clip.len(), 2], self.colors.clone()).unwrap());
        let image = picture(tape.leaf(&tensor(clip)), colors, &self.mesh(), exact(self.size));
        image.value().data().iter().zip(self.upstream().data()).map(|(x, u)| x * u).sum()
    }

    fn gradient(&self) -> Vec<f64> {
        let tape = Tape::<f64>::new();
        let colors =
            tape.constant(&Tensor::new([self.clip.len(), 2], self.colors.clone()).unwrap());
        let positions = tape.leaf(&tensor(&self.clip));
        let image = picture(positions, colors, &self.mesh(), exact(self.size));
        tape.vjp(&[(image, &self.upstream())]).unwrap().get_or_zeros(positions).data().to_vec()
    }

    /// The central difference quotient of each entry. The second derivative leaps at a border, so
    /// that its error goes with the step, and with its square where a face is thin. By a step, its half
    /// and its quarter both are taken out.
    fn check(&self) -> Result<(), TestCaseError> {
        for (k, found) in self.gradient().into_iter().enumerate() {
            if !self.is_flat && k % 4 > 1 {
                continue;
            }
            let quotient = |step: f64| {
                let by = |step: f64| {
                    let mut moved = self.clip.clone();
                    moved[k / 4][k % 4] += step;
                    self.loss(&moved)
                };
                (by(step) - by(-step)) / (2.0 * step)
            };
            let [coarse, middle, fine] = [2e-5, 1e-5, 5e-6].map(quotient);
            let expected = (8.0 * fine - 6.0 * middle + coarse) / 3.0;
            prop_assert!(
                (found - expected).abs() < 1e-6 * (1.0 + expected.abs()),
                "entry {k}: {found} instead of {expected} ({coarse}, {middle}, {fine})"
            );
        }
        Ok(())
    }
}

/// Two rectangles, one before the other, with or without a wall behind: sides on borders or not, exactly
/// or nearly, and no two of different rectangles on one line.
fn rectangles() -> impl Strategy<Value = Scene> {
    let lines = |extent: usize| {
        let all: Vec<_> = (0..=extent).map(|k| k as f64).collect();
        let line = prop_oneof![6 => Just(0.0), 1 => 0.1..0.9];
        let inwards = prop::array::uniform4(line);
        (prop::sample::subsequence(all, 4), inwards, 0..6_usize).prop_map(
            move |(borders, inwards, which)| {
                let places: Vec<_> = borders
                    .iter()
                    .zip(inwards)
                    .map(|(&border, inwards)| (border + inwards).min(extent as f64))
                    .collect();
                let pair = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]][which];
                let other = [[2, 3], [1, 3], [1, 2], [0, 3], [0, 2], [0, 1]][which];
                [pair, other].map(|pair| pair.map(|at| places[at]))
            },
        )
    };
    let off = prop_oneof![3 => Just(0.0), 1 => -1e-15..1e-15, 1 => -2e-16..2e-16];
    let scene = (3..10_usize, 3..10_usize).prop_flat_map(move |(width, height)| {
        (
            Just(Size { width, height }),
            lines(width),
            lines(height),
            proptest::collection::vec(0.0..1.0, 24),
            proptest::collection::vec(prop_oneof![Just(1.0), 0.5..2.0], 12),
            proptest::collection::vec(off.clone(), 24),
            any::<u64>(),
            any::<[bool; 4]>(),
        )
    });
    scene.prop_map(|(size, xs, ys, mut colors, ws, off, upstream, flags)| {
        let [has_wall, is_flat, is_half, is_turned] = flags;
        let mut clip = Clip::new();
        for k in 0..2 {
            let ([x, x_end], [y, y_end]) = (xs[k], ys[k]);
            clip.extend(rectangle([x, y], [x_end, y_end], [0.1, 0.5][k], size));
        }
        // No diagonal lies before another one.
        let mut faces = vec![[0, 1, 2], [1, 2, 3], [4, 5, 7], [4, 6, 7]];
        if is_half {
            faces.remove(1);
        }
        if has_wall {
            let (low, high) = ([-1.3, -1.7], [size.width as f64 + 1.2, size.height as f64 + 0.7]);
            clip.extend(rectangle(low, high, 0.8, size));
            faces.extend([[8, 9, 10], [9, 10, 11]]);
        }
        if is_turned {
            faces.reverse();
        }
        for (at, vertex) in clip.iter_mut().enumerate() {
            let w = if is_flat { ws[at] } else { ws[at / 4] };
            (vertex[0], vertex[1]) =
                (vertex[0] * (1.0 + off[2 * at]), vertex[1] * (1.0 + off[2 * at + 1]));
            *vertex = vertex.map(|c| c * w);
        }
        colors.truncate(2 * clip.len());
        if is_flat {
            for vertices in colors.chunks_exact_mut(8) {
                let [a, b] = [vertices[0], vertices[1]];
                vertices.chunks_exact_mut(2).for_each(|color| color.copy_from_slice(&[a, b]));
            }
        }
        Scene { size, clip, colors, faces, upstream, is_flat }
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(300) })]

    #[test]
    fn the_gradient_of_sides_on_borders_is_the_central_difference_quotient(scene in rectangles()) {
        scene.check()?;
    }

    /// Two planes meet on a border, or one alone leaves the depth range there.
    #[test]
    fn the_gradient_of_intersections_on_borders_is_the_central_difference_quotient(
        width in 2..9_usize,
        height in 2..9_usize,
        border in 0..8_usize,
        is_row: bool,
        // Planes that are nearly parallel meet nearly anywhere.
        slopes in prop::array::uniform2((-4..5).prop_map(|tenths| 0.1 * f64::from(tenths))),
        far in 0..3_usize,
        colors in prop::array::uniform4(0.0..1.0),
        upstream: u64,
    ) {
        prop_assume!(slopes[0] != if far == 0 { slopes[1] } else { 0.0 });
        let size = Size { width, height };
        let extent = if is_row { height } else { width };
        let middle = 2.0 * (1 + border % (extent - 1)) as f64 / extent as f64 - 1.0;
        let depth = [0.0, 1.0, -1.0][far];
        let mut clip = Clip::new();
        for &slope in &slopes[..if far == 0 { 2 } else { 1 }] {
            clip.extend([[-3.0, -3.0], [9.0, -3.0], [-3.0, 9.0]].map(|place: [f64; 2]| {
                let from_border = place[usize::from(is_row)] - middle;
                [place[0], place[1], depth + slope * from_border, 1.0]
            }));
        }
        let colors = (0..2 * clip.len()).map(|k| colors[k / 6 * 2 + k % 2]).collect();
        let faces = (0..clip.len() as u32 / 3).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        Scene { size, clip, colors, faces, upstream, is_flat: true }.check()?;
    }
}

/// A fifth of a pixel high and eight pixels wide, with a corner on borders: its second derivative is large.
#[test]
fn a_thin_face_whose_corner_is_on_borders_has_the_central_derivative() -> Result<(), TestCaseError>
{
    let (left, top, border) = (-7.0 / 9.0, 0.771_675_494_461_856_3, 5.0 / 7.0);
    let clip =
        vec![[left, top, 0.1, 1.0], [1.0, top, 0.1, 1.0], [0.5 * left, 0.5 * border, 0.05, 0.5]];
    let (size, colors) = (Size { width: 9, height: 7 }, vec![0.9, 0.0, 0.9, 0.0, 0.9, 0.0]);
    let upstream = 12_912_720_851_596_686_132;
    Scene { size, clip, colors, faces: vec![[0, 1, 2]], upstream, is_flat: true }.check()
}

/// In f32 as in f64, where f32 has the places.
#[test]
fn sides_on_borders_have_one_gradient_in_both_precisions() {
    let size = Size::square(16);
    let along: Clip =
        (0..8).map(|k| [0.1 * f64::from(k), 1.0 - 0.2 * f64::from(k), 0.0, 0.0]).collect();
    let mut clip = rectangle([4.0, 3.0], [9.0, 12.0], 0.0, size);
    clip.extend(rectangle([2.0, 5.0], [13.0, 8.0], 0.5, size));
    let faces = [[0, 1, 2], [1, 2, 3], [4, 5, 6], [5, 6, 7]];
    let wide = slope::<f64>(&clip, &along, &faces, size, |image| image.square().sum());
    let narrow = slope::<f32>(&clip, &along, &faces, size, |image| image.square().sum());
    assert!((wide - narrow).abs() < 1e-4 * wide.abs(), "{wide} {narrow}");
    assert!(wide.abs() > 1.0);
}

/// A square of so many faces that its pixel is cut.
#[test]
fn sides_on_the_borders_of_a_crowded_pixel_count_half() {
    const FACES: u32 = 800;
    let size = Size::square(3);
    let mut clip: Clip = vec![[0.03, -0.02, 0.0, 1.0]];
    for k in 0..FACES {
        let (side, share) =
            (k / (FACES / 4), 2.0 * f64::from(k % (FACES / 4)) / f64::from(FACES / 4) - 1.0);
        let [x, y] = [[-1.0, share], [share, 1.0], [1.0, -share], [-share, -1.0]][side as usize];
        clip.push([x / 3.0, y / 3.0, 0.0, 1.0]);
    }
    let faces: Vec<_> = (0..FACES).map(|k| [0, 1 + k, 1 + (k + 1) % FACES]).collect();
    let along: Clip = clip
        .iter()
        .map(|p| if p[0] == 0.03 { [0.0; 4] } else { [3.0 * p[0], 3.0 * p[1], 0.0, 0.0] })
        .collect();
    // Half the side is 0.5 pixels and grows by 1.5: four sides of one pixel.
    let sum = slope::<f64>(&clip, &along, &faces, size, |image| image.sum());
    assert!((sum - 6.0).abs() < 1e-11, "{sum}");
}
