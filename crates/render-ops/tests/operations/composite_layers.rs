use bokashi_core::{Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Layer, Mesh, Size, composite_layers, depth_layers, rasterize,
};

const SIZE: Size = Size { width: 9, height: 7 };

/// Three walls one behind another, each smaller than the wall behind it, given in any order.
fn walls(tape: &Tape<f64>, order: [usize; 3]) -> (Var<'_, f64>, Mesh) {
    let corners = |k: usize| {
        let (reach, z) = (0.5 + 0.3 * k as f64, 0.3 * k as f64);
        [[-reach, -reach, z, 1.0], [3.0 * reach, -reach, z, 1.0], [-reach, 3.0 * reach, z, 1.0]]
    };
    let all: Vec<f64> = order.iter().flat_map(|&k| corners(k)).flatten().collect();
    let faces = (0..3).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    (tape.leaf(&Tensor::new([9, 4], all).unwrap()), Mesh::new(faces, 9).unwrap())
}

fn colors(k: usize) -> [f64; 2] {
    [0.2 + 0.3 * k as f64, 0.9 - 0.25 * k as f64]
}

/// The picture of the walls, each with an alpha of its own.
fn picture(order: [usize; 3], alpha: impl Fn(usize) -> f64) -> Tensor<f64> {
    let tape = Tape::new();
    let (clip, mesh) = walls(&tape, order);
    let fragments = depth_layers(clip, &mesh, SIZE, None).unwrap();
    assert_eq!(fragments.len(), 3);
    let all: Vec<_> = fragments
        .iter()
        .map(|fragments| {
            let faces: Vec<_> = fragments.coverage.faces().map(|face| order[face]).collect();
            let color =
                Tensor::from_fn([faces.len(), 2], |[n, c]| alpha(faces[n]) * colors(faces[n])[c]);
            let alphas = Tensor::from_fn([faces.len()], |[n]| alpha(faces[n]));
            (tape.leaf(&color), tape.leaf(&alphas))
        })
        .collect();
    let layers: Vec<_> = fragments
        .iter()
        .zip(&all)
        .map(|(fragments, &(premultiplied, alpha))| Layer { fragments, premultiplied, alpha })
        .collect();
    let behind = Background::Color(tape.leaf(&Tensor::full([2], 0.5)));
    composite_layers(&layers, behind).unwrap().image().unwrap().value()
}

#[test]
fn each_layer_shows_as_much_as_those_in_front_let_through_in_any_order_of_faces() {
    let alpha = |k: usize| [0.25, 0.5, 0.8][k];
    let image = picture([0, 1, 2], alpha);
    for order in [[2, 1, 0], [1, 2, 0], [0, 2, 1]] {
        assert_eq!(picture(order, alpha), image);
    }
    let tape = Tape::<f64>::new();
    for pixel in 0..SIZE.pixels() {
        // From back to front, each wall where it alone covers the pixel.
        let mut expected = [0.5; 2];
        for k in (0..3).rev() {
            let (clip, _) = walls(&tape, [k; 3]);
            let one = Mesh::new(vec![[0, 1, 2]], 9).unwrap();
            let covers = rasterize(clip, &one, SIZE).unwrap().coverage.fragment_at(pixel);
            if covers.is_some() {
                for c in 0..2 {
                    expected[c] += alpha(k) * (colors(k)[c] - expected[c]);
                }
            }
        }
        for c in 0..2 {
            approx::assert_relative_eq!(image.data()[2 * pixel + c], expected[c], epsilon = 1e-15);
        }
    }
}

#[test]
fn opaque_layers_are_the_nearest_alone_and_clear_layers_the_background() {
    let opaque = picture([0, 1, 2], |_| 1.0);
    let tape = Tape::<f64>::new();
    let (clip, mesh) = walls(&tape, [0, 1, 2]);
    let nearest = rasterize(clip, &mesh, SIZE).unwrap().coverage;
    for pixel in 0..SIZE.pixels() {
        let expected = nearest.face_at(pixel).map_or([0.5; 2], colors);
        assert_eq!(opaque.data()[2 * pixel..][..2], expected);
    }
    assert!(picture([0, 1, 2], |_| 0.0).data().iter().all(|&entry| entry == 0.5));
}
