use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::{
    Background, Fragments, LensLayer, Mesh, RasterOptions, Sampling, Size, ThinLens,
    ThinLensOptions, depth_layers, eye_depth, interpolate, lens_picture, rasterize,
};

/// Large enough for tiles from which no outline can be seen.
const SIZE: Size = Size { width: 150, height: 90 };

/// A board at the left, and a slanted wall behind it that fills the picture: faces of two triangles.
fn clip() -> Tensor<f64> {
    let board = [[-3.0, -3.0, 2.0], [-0.2, -3.0, 2.0], [-0.2, 3.0, 2.0], [-3.0, 3.0, 2.0]];
    let wall = [[-9.0, -9.0, 4.0], [9.0, -9.0, 4.0], [9.0, 9.0, 5.0], [-9.0, 9.0, 5.0]];
    let corners: Vec<_> = board.into_iter().chain(wall).collect();
    Tensor::from_fn([8, 4], |[vertex, axis]| {
        let [x, y, z] = corners[vertex];
        [x, y, 0.5 * z, z][axis]
    })
}

fn wave(k: usize) -> f64 {
    0.5 + 0.4 * (k as f64 * 0.7).sin()
}

/// Which numbers are made, and which are asked for.
#[derive(Debug, Clone, Copy)]
struct Setting {
    aperture: f64,
    sampling: Sampling,
    has_image_behind: bool,
    /// Whether alphas are learnt.
    learns_alpha: bool,
    /// Slopes of 0 for all.
    has_slopes: bool,
    margin: usize,
    /// The focus: the board is 2 away.
    focus: f64,
    /// What is added to the colours that are hidden before a column.
    hidden: (usize, f64),
}

fn layer<'a, 't>(
    fragments: &'a Fragments<'t, f64>,
    setting: Setting,
    added: impl Fn(usize) -> f64,
) -> LensLayer<'a, 't, f64> {
    let (tape, count) = (fragments.clip.tape(), fragments.coverage.count());
    let ones = Tensor::full([count], 1.0);
    let alpha = if setting.learns_alpha { tape.leaf(&ones) } else { tape.constant(&ones) };
    let colors = Tensor::from_flat_fn([count, 2], |k| wave(k) + added(k / 2));
    let premultiplied = tape.leaf(&colors);
    let distance = tape.leaf(&eye_depth(fragments).unwrap().values().value());
    let slope = setting.has_slopes.then(|| tape.constant(&Tensor::zeros([count, 2])));
    LensLayer { fragments, premultiplied, alpha, distance, slope }
}

/// The picture, and its gradients by the visible colours, the distances, what the board hides, aperture, focus and
/// background.
fn seen(setting: Setting) -> [Vec<f64>; 7] {
    let tape = Tape::<f64>::new();
    let clip = tape.constant(&clip());
    let faces = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
    let mesh = Mesh::new(faces, 8).unwrap();
    let options = RasterOptions::new(SIZE);
    let visible = rasterize(clip, &mesh, options.sampling(setting.sampling).creases(&[])).unwrap();
    let hidden = depth_layers(clip, &mesh, options.sampling(Sampling::Center), Some(2)).unwrap();
    let columns: Vec<_> = hidden[1].coverage.pixels().map(|pixel| pixel % SIZE.width).collect();
    let (end, added) = setting.hidden;
    let wall = |k: usize| if columns[k] < end { added } else { 0.0 };
    let first = layer(&visible, setting, |_| 0.0);
    let behind = [layer(&hidden[0], setting, |_| 0.0), layer(&hidden[1], setting, wall)];
    let [aperture, focus] =
        [setting.aperture, setting.focus].map(|number| tape.leaf_scalar(number));
    let shape: &[usize] = if setting.has_image_behind { &[90, 150, 2] } else { &[2] };
    let background = tape.leaf(&Tensor::from_flat_fn(shape, wave));
    let sky = match setting.has_image_behind {
        true => Background::Image(background),
        false => Background::Color(background),
    };
    let lens = ThinLens { aperture, focus };
    let Setting { margin, .. } = setting;
    let options = ThinLensOptions { margin, ..ThinLensOptions::default() };
    let found = lens_picture(first, &behind, sky, f64::INFINITY, lens, &options).unwrap().image;
    let shown = [SIZE.height - 2 * margin, SIZE.width - 2 * margin, 2];
    let upstream = Tensor::from_flat_fn(shown, |k| wave(3 * k));
    let gradients = tape.vjp(&[(found, &upstream)]).unwrap();
    let asked =
        [first.premultiplied, first.distance, behind[1].premultiplied, aperture, focus, background];
    let [a, b, c, d, e, f] = asked.map(|var| gradients.get_or_zeros(var).data().to_vec());
    [found.value().data().to_vec(), a, b, c, d, e, f]
}

const SETTING: Setting = Setting {
    aperture: 4.0,
    sampling: Sampling::Center,
    has_image_behind: false,
    learns_alpha: false,
    has_slopes: false,
    margin: 0,
    focus: 4.2,
    hidden: (0, 0.0),
};

#[test]
fn pixels_that_are_worked_on_together_are_those_that_are_worked_on_alone() {
    // At the larger apertures images are halved. The last one has its board in focus, and the wall hardly out of it.
    let lenses = [(4.0, 4.2, 0), (13.0, 4.2, 3), (40.0, 4.2, 0), (0.4, 2.0, 0)];
    for (aperture, focus, margin) in lenses {
        for sampling in [Sampling::Center, Sampling::Exact] {
            for has_slopes in [false, true] {
                let has_image_behind = has_slopes;
                let lens = Setting { aperture, focus, margin, ..SETTING };
                let setting = Setting { sampling, has_slopes, has_image_behind, ..lens };
                let together = seen(setting);
                // Where alphas are learnt, each pixel is worked on alone.
                let alone = seen(Setting { learns_alpha: true, ..setting });
                for (together, alone) in together.iter().zip(&alone) {
                    let largest = alone.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
                    assert_eq!(together.len(), alone.len());
                    for (a, b) in together.iter().zip(alone) {
                        assert!((a - b).abs() <= 1e-12 * largest, "{a} is not {b}: {setting:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn as_many_layers_as_can_be_are_seen_with_their_slopes() {
    let tape = Tape::<f64>::new();
    let clip = tape.leaf(&clip());
    let mesh = Mesh::new(vec![[0, 1, 2], [0, 2, 3]], 8).unwrap();
    let options = RasterOptions::new(Size { width: 9, height: 7 });
    let exact = rasterize(clip, &mesh, options.sampling(Sampling::Exact).creases(&[])).unwrap();
    let centers = rasterize(clip, &mesh, options.sampling(Sampling::Center)).unwrap();
    let colors = |fragments| interpolate(clip, fragments).unwrap();
    let ones = |n: usize| tape.leaf(&Tensor::full([n], 1.0));
    let [visible, behind] = [&exact, &centers].map(|fragments| {
        let alpha = ones(fragments.coverage.count());
        LensLayer::from_fragments(fragments, colors(fragments), alpha).unwrap()
    });
    let lens = ThinLens { aperture: tape.leaf_scalar(2.0), focus: tape.leaf_scalar(3.0) };
    let seen = |count: usize| {
        let behind = vec![behind; count];
        let options = ThinLensOptions::default();
        lens_picture(visible, &behind, Background::Zero, f64::INFINITY, lens, &options)
    };
    let image = seen(14).unwrap().image;
    let gradients = tape.vjp(&[(image, &image.value())]).unwrap();
    let all = [visible.distance, behind.slope.unwrap(), lens.focus];
    for gradient in all.map(|var| gradients.get_or_zeros(var)) {
        assert!(gradient.data().iter().all(|bar| bar.is_finite()));
    }
    let refused = seen(15).unwrap_err().to_string();
    assert_eq!(refused, "lens_picture needs at most 14 layers behind, got 15");
}

#[test]
fn what_is_hidden_is_looked_at_beside_outlines_alone() {
    // The board ends at column 67; its circles have a radius of 4.4 pixels.
    let [image, .., hidden, _, _, _] = seen(SETTING);
    let far = seen(Setting { hidden: (20, 0.5), ..SETTING });
    assert_eq!(far[0], image);
    let near = seen(Setting { hidden: (67, 0.5), ..SETTING });
    assert_ne!(near[0], image);
    assert!(hidden.iter().any(|&bar| bar != 0.0));
}
