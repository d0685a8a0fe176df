//! Coverage that comes back from an image of triangle ids, and dense images of fragments.

use std::sync::Arc;

use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::{
    Coverage, Cull, Fragments, Mesh, RasterOptions, RenderError, Sampling, Size, antialias_image,
    interpolate, project, rasterize,
};
use glam::DMat4;

use crate::fixtures::{bent_sheet, number};

/// A bent sheet over several bands, part of it out of view.
fn sheet() -> (Mesh, Tensor<f64>, Size) {
    let (positions, faces) = bent_sheet(12, 9);
    let count = positions.len() / 3;
    let mesh = Mesh::new(faces, count).unwrap();
    (mesh, Tensor::new([count, 3], positions).unwrap(), Size { width: 150, height: 260 })
}

#[test]
fn fragments_of_ids_are_those_that_the_ids_came_from_to_every_operation() {
    let (mesh, positions, size) = sheet();
    for cull in [Cull::None, Cull::Back, Cull::Front] {
        let tape = Tape::new();
        let clip =
            project(tape.leaf(&positions), &DMat4::from_scale(glam::dvec3(1.3, 0.9, 0.2)), None);
        let clip = clip.unwrap();
        let drawn = rasterize(clip, &mesh, RasterOptions::new(size).cull(cull)).unwrap();
        let ids = drawn.coverage.triangle_ids();
        let coverage = Coverage::from_ids(&mesh, size, &ids).unwrap();
        assert!(coverage.runs().eq(drawn.coverage.runs()));
        assert_eq!(coverage.triangle_ids(), ids);
        let image = tape.leaf(&Tensor::from_flat_fn([size.height, size.width, 2], number));
        let mut back = Fragments { coverage: Arc::new(coverage.clone()), ..drawn.clone() };
        assert_eq!(
            antialias_image(image, &back).unwrap_err().to_string(),
            "antialias_image needs to know which way faces turn: \
             `coverage.with_orientations(&clip, cull)`"
        );
        let coverage = coverage.with_orientations(&clip.value(), cull).unwrap();
        back.coverage = Arc::new(coverage);
        let seen = |fragments: &Fragments<'_, f64>| {
            let surface = interpolate(tape.leaf(&positions), fragments).unwrap();
            let image = antialias_image(image, fragments).unwrap();
            let loss = surface.square().sum() + image.square().sum();
            let gradient = loss.backward_to(&[clip]).unwrap().get_or_zeros(clip);
            (surface.value(), image.value(), gradient)
        };
        assert_eq!(seen(&back), seen(&drawn));
        assert!(cull == Cull::Front || drawn.coverage.count() > 1000);
        assert!(cull == Cull::Front || seen(&back).1 != image.value(), "nothing was blended");
    }
}

#[test]
fn rows_of_fragments_become_a_dense_image_and_come_back() {
    let (mesh, positions, size) = sheet();
    let tape = Tape::new();
    let clip = project(tape.leaf(&positions), &DMat4::IDENTITY, None).unwrap();
    for sampling in [Sampling::Center, Sampling::Exact] {
        let options = RasterOptions::new(size).sampling(sampling).creases(&[]);
        let coverage = rasterize(clip, &mesh, options).unwrap().coverage;
        let values: Vec<_> = (0..2 * coverage.count()).map(number).collect();
        let (mut image, mut back) = (vec![f64::NAN; 2 * size.pixels()], vec![7.0; values.len()]);
        coverage.scatter(&values, 2, &mut image);
        coverage.gather(&image, 2, &mut back);
        let centers = 2 * coverage.centers();
        assert_eq!(back[..centers], values[..centers]);
        assert!(back[centers..].iter().all(|&piece| piece == 7.0));
        assert_eq!(image.iter().filter(|entry| !entry.is_nan()).count(), centers);
        // Runs list each fragment once, with its face and pixel.
        let of_runs = coverage.runs().flat_map(|run| {
            run.pixels.zip(run.fragments).map(move |(pixel, fragment)| (fragment, pixel, run.face))
        });
        let places = coverage.pixels().zip(coverage.faces()).enumerate();
        assert!(of_runs.eq(places.map(|(fragment, (pixel, face))| (fragment, pixel, face))));
    }
}

#[test]
fn what_is_no_image_of_ids_is_refused() {
    let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
    let size = Size { width: 3, height: 2 };
    let refused = |size: Size, ids: &[u32]| Coverage::from_ids(&mesh, size, ids).unwrap_err();
    let message = "a triangle id needs to be at most the number of faces, 1, got 2 at pixel 4";
    assert_eq!(refused(size, &[0, 1, 1, 0, 2, 3]).to_string(), message);
    let message = "Coverage::from_ids needs an id for each of the 6 pixels, got shape [5]";
    assert_eq!(refused(size, &[0; 5]).to_string(), message);
    let size = Size { width: 0, height: 2 };
    assert_eq!(refused(size, &[]), RenderError::ImageSize { size });
    let none = Mesh::new(Vec::new(), 0).unwrap();
    assert_eq!(Coverage::from_ids(&none, Size::square(1), &[0]).unwrap().count(), 0);
    // A row that is wider than a band.
    let wide = Size { width: 40_000, height: 2 };
    let ids: Vec<_> = (0..80_000).map(|pixel| u32::from(pixel % 3 == 1)).collect();
    let coverage = Coverage::from_ids(&mesh, wide, &ids).unwrap();
    assert_eq!((coverage.count(), coverage.triangle_ids()), (26_667, ids));
    let coverage = Coverage::from_ids(&mesh, Size::square(2), &[0; 4]).unwrap();
    assert_eq!((coverage.count(), coverage.runs().count()), (0, 0));
    for (clip, message) in [
        (
            Tensor::zeros([2, 4]),
            "Coverage::with_orientations needs clip positions of shape [3, 4], got shape [2, 4]",
        ),
        (
            Tensor::full([3, 4], f64::NAN),
            "clip positions need to be finite, got (NaN, NaN, NaN, NaN) at vertex 0",
        ),
    ] {
        let refused = coverage.clone().with_orientations(&clip, Cull::None).unwrap_err();
        assert_eq!(refused.to_string(), message);
    }
}
