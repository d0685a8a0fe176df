//! Pictures of a cube for people: any size, in `f64`, and its outline for wireframes.

use bokashi_core::{Tape, Tensor};
use bokashi_fit::FitError;
use bokashi_render_ops::{Blur, Border, Kernel, Radius, Silhouettes};
use glam::DVec4;

use super::cube::{FACES, VERTEX_COUNT, View};
use super::outcome::Snapshot;
use super::scene::Scene;

/// The cube `snapshot` in front of black, `[size, size, 3]`, row 0 on top. It may have a blur: weights,
/// and a sigma in pixels of this picture. The snapshot's own sigma, which is in pixels of the fit, plays
/// no part.
///
/// # Errors
/// [`FitError::Render`] for a size or a sigma that the operations refuse.
pub fn picture(
    snapshot: &Snapshot,
    size: usize,
    silhouettes: Silhouettes,
    blur: Option<(Kernel, f64)>,
    view: &View,
) -> Result<Tensor<f64>, FitError> {
    // The tails beyond are lost in 8 bits per channel.
    let radius = Radius::Tolerance(1e-4);
    let of_kernel = |(kernel, _)| Blur { kernel, border: Border::Zero, radius };
    let scene = Scene::new(size, silhouettes, blur.map(of_kernel))?;
    let tape = Tape::new();
    let vertices = tape.constant(&snapshot.vertices);
    let colors = tape.constant(&snapshot.colors);
    let sigma = blur.map(|(_, sigma)| tape.constant_scalar(sigma));
    Ok(scene.image(&view.camera(), vertices, colors, sigma)?.value())
}

/// Where the vertices of `snapshot` are in its [`picture`]: column and row in pixels, from the top
/// left corner of the picture.
pub fn outline(snapshot: &Snapshot, size: usize, view: &View) -> [[f64; 2]; VERTEX_COUNT] {
    let camera = view.camera();
    let vertices = snapshot.vertices.data();
    std::array::from_fn(|v| {
        let [x, y, z] = [0, 1, 2].map(|axis| vertices[3 * v + axis]);
        let clip = camera * DVec4::new(x, y, z, 1.0);
        let half = 0.5 * size as f64;
        [half * (1.0 + clip.x / clip.w), half * (1.0 - clip.y / clip.w)]
    })
}

/// The 18 edges of the triangulation, each as a pair of vertices in increasing order.
pub fn edges() -> Vec<[usize; 2]> {
    let sides = |&[a, b, c]: &[u32; 3]| [[a, b], [b, c], [c, a]];
    let ordered = |[a, b]: [u32; 2]| [a.min(b) as usize, a.max(b) as usize];
    let mut edges: Vec<_> = FACES.iter().flat_map(sides).map(ordered).collect();
    edges.sort_unstable();
    edges.dedup();
    edges
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth;

    #[test]
    fn an_outline_is_where_perspective_puts_the_vertices() {
        let places = outline(&truth(None), 100, &View::angles([0.0, 0.0]));
        for (v, [column, row]) in places.into_iter().enumerate() {
            let sign = |bit: usize| if v >> bit & 1 == 1 { 1.0 } else { -1.0 };
            // 3.5 - z from the camera; a half-width of 0.4 at distance 1.
            let reach = 50.0 * 0.5 / 0.4 / (3.5 - 0.5 * sign(0));
            assert!((column - (50.0 + sign(2) * reach)).abs() < 1e-12);
            assert!((row - (50.0 - sign(1) * reach)).abs() < 1e-12);
        }
    }

    #[test]
    fn a_picture_fills_its_outline() {
        let (cube, size, view) = (truth(None), 64, View::random(3, 0));
        let image = picture(&cube, size, Silhouettes::Aliased, None, &view).unwrap();
        assert_eq!(image.shape()[..], [size, size, 3]);
        let lit = |k: &usize| image.data()[3 * k..][..3].iter().any(|&channel| channel > 0.0);
        let lit: Vec<usize> = (0..size * size).filter(lit).collect();
        let places = outline(&cube, size, &view);
        for axis in 0..2 {
            let of_pixel = |k: &usize| 0.5 + [k % size, k / size][axis] as f64;
            let ends = |values: &mut dyn Iterator<Item = f64>| {
                values.fold([f64::MAX, f64::MIN], |[low, high], x| [low.min(x), high.max(x)])
            };
            let inside = ends(&mut lit.iter().map(of_pixel));
            let outside = ends(&mut places.iter().map(|place| place[axis]));
            // A corner sharper than a right angle may miss the centres of a few pixels.
            assert!(inside[0] >= outside[0] && inside[0] < outside[0] + 3.0);
            assert!(inside[1] <= outside[1] && inside[1] > outside[1] - 3.0);
        }
    }

    #[test]
    fn no_blur_and_no_silhouette_takes_a_picture_out_of_black_to_white() {
        let cube = truth(None);
        for silhouettes in [Silhouettes::Aliased, Silhouettes::Antialias, Silhouettes::Exact] {
            let of = |size, blur| picture(&cube, size, silhouettes, blur, &View::fixed());
            for blur in [None, Some((Kernel::Sampled, 1.5)), Some((Kernel::Disc, 1.5))] {
                let image = of(32, blur).unwrap();
                let inside = |channel: &f64| (-1e-12..=1.0 + 1e-12).contains(channel);
                assert!(image.data().iter().all(inside), "{silhouettes}");
            }
            assert!(
                of(32, Some((Kernel::Disc, -1.0))).is_err() && of(0, None).is_err(),
                "{silhouettes}"
            );
        }
    }

    #[test]
    fn exact_coverage_is_nearer_to_the_mean_over_a_pixel_than_antialias_than_aliased() {
        let (cube, size, times) = (truth(None), 16, 16);
        let of = |size, silhouettes| {
            picture(&cube, size, silhouettes, None, &View::fixed()).unwrap().data().to_vec()
        };
        let mut mean = vec![0.0; size * size * 3];
        for (at, &channel) in of(size * times, Silhouettes::Aliased).iter().enumerate() {
            let (row, column) = (at / 3 / (size * times) / times, at / 3 % (size * times) / times);
            mean[3 * (row * size + column) + at % 3] += channel / (times * times) as f64;
        }
        let error = |silhouettes| -> f64 {
            let image = of(size, silhouettes);
            image.iter().zip(&mean).map(|(seen, mean)| (seen - mean).powi(2)).sum()
        };
        let [aliased, antialias, exact] =
            [Silhouettes::Aliased, Silhouettes::Antialias, Silhouettes::Exact].map(error);
        assert!(
            0.1 * aliased > antialias && 0.1 * antialias > exact,
            "{aliased} {antialias} {exact}"
        );
    }
}
