use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::{
    Background, Mesh, RasterOptions, Sampling, Silhouettes, Size, antialias, composite,
    interpolate, rasterize, render,
};

#[test]
fn a_picture_in_one_call_is_that_of_the_single_operations() {
    let mesh = Mesh::new(vec![[0, 1, 2], [2, 1, 3]], 4).unwrap();
    let corners = [[-0.7, -0.8], [0.9, -0.5], [-0.4, 0.7], [0.8, 0.6]];
    let corners = Tensor::from_fn([4, 4], |[vertex, k]| match k {
        0 | 1 => corners[vertex][k],
        2 => 0.0,
        _ => 1.0,
    });
    let options = RasterOptions::new(Size { width: 13, height: 9 });
    for silhouettes in [Silhouettes::Aliased, Silhouettes::Antialias, Silhouettes::Exact] {
        let tape = Tape::<f64>::new();
        let (clip, sky) = (tape.leaf(&corners), tape.leaf(&Tensor::from([0.1, 0.7])));
        let colors = tape.leaf(&Tensor::from([[0.2, 0.4], [0.9, 0.1], [0.3, 1.0], [0.5, 0.6]]));
        let background = Background::Color(sky);
        let options = options.silhouettes(silhouettes);
        let picture = render(clip, &mesh, colors, options, background).unwrap();
        let fragments = rasterize(clip, &mesh, options.creases(&[colors.into()])).unwrap();
        let surface = interpolate(colors, &fragments).unwrap();
        let composite = composite(surface, &fragments, background).unwrap();
        let expected = match silhouettes {
            Silhouettes::Antialias => antialias(composite).unwrap(),
            Silhouettes::Aliased | Silhouettes::Exact => composite.into(),
        };
        let images = [picture, expected].map(|picture| picture.image().unwrap());
        assert_eq!(images[0].value(), images[1].value(), "{silhouettes}");
        let [found, expected] = images.map(|image| image.square().sum().backward().unwrap());
        for variable in [clip, colors, sky] {
            assert_eq!(found.get_or_zeros(variable), expected.get_or_zeros(variable));
        }
        assert!(silhouettes != Silhouettes::Exact || fragments.weight.is_some());
    }
}

#[test]
fn only_pixel_centres_are_blended() {
    let tape = Tape::<f32>::new();
    let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
    let corners = [-0.8, -0.9, 0.0, 1.0, 0.9, -0.7, 0.0, 1.0, 0.1, 0.8, 0.0, 1.0];
    let clip = tape.leaf(&Tensor::new([3, 4], corners.to_vec()).unwrap());
    for sampling in [Sampling::Center, Sampling::Exact] {
        let options = RasterOptions::new(Size::square(8)).sampling(sampling);
        let fragments = rasterize(clip, &mesh, options.creases(&[])).unwrap();
        let white = tape.constant_full([fragments.coverage.count(), 1], 1.0);
        fragments.picture(white, Background::Zero).unwrap();
        let is_blended =
            tape.take_report().operations.iter().any(|entry| entry.name == "antialias");
        assert_eq!(is_blended, sampling == Sampling::Center);
    }
}
