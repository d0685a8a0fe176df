//! Laws of an atlas.

use bokashi_core::{Tape, Tensor, TensorError};
use bokashi_render_ops::glam::DVec3;
use bokashi_render_ops::{
    Detail, Mesh, Sampler, Texture, TextureBorder, TextureFilter, sample_texture,
};

use super::options::reach;
use super::{Atlas, AtlasOptions, COVERED, TexelMap, atlas};
use crate::draw_points;
use crate::error::MeshError;
use crate::fixtures::{Model, cube, sheet, sphere, tetrahedron, torus};
use crate::triangle::{area_vector, nearest};

const SIZE: usize = 256;

/// A ramp that winds around an axis three times, on its own shadow.
fn ramp() -> Model {
    let (mut points, mut faces) = (Vec::new(), Vec::new());
    for k in 0..=72_u32 {
        let angle = f64::from(k) * 15_f64.to_radians();
        let along = DVec3::new(angle.cos(), angle.sin(), 0.0);
        points.extend([1.0, 2.0].map(|radius| radius * along + 0.1 * angle * DVec3::Z));
        if k > 0 {
            let [a, b, c, d] = [2 * k - 2, 2 * k - 1, 2 * k, 2 * k + 1];
            faces.extend([[a, b, d], [a, d, c]]);
        }
    }
    Model { points, faces }
}

/// A narrow band around an axis, a turn and a quarter, that rises beside its own start.
fn spiral() -> Model {
    let (mut points, mut faces) = (Vec::new(), Vec::new());
    for k in 0..=450_u32 {
        let angle = f64::from(k).to_radians();
        let along = DVec3::new(angle.cos(), angle.sin(), 0.0);
        let radius = 1.0 + 0.006 * f64::from(k) / 360.0;
        let rise = 0.2 * f64::from(k) / 360.0;
        points.extend([0.0, 0.003].map(|side| (radius + side) * along + rise * DVec3::Z));
        if k > 0 {
            let [a, b, c, d] = [2 * k - 2, 2 * k - 1, 2 * k, 2 * k + 1];
            faces.extend([[a, b, d], [a, d, c]]);
        }
    }
    Model { points, faces }
}

fn models() -> Vec<(&'static str, Model)> {
    let twice = Model { faces: [cube().faces, cube().faces].concat(), ..cube() };
    let moebius = Model {
        faces: vec![[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4], [4, 5, 1], [5, 0, 1]],
        ..sphere(1)
    };
    let far = |offset| move |point: DVec3| point + offset * DVec3::X;
    vec![
        ("tetrahedron", tetrahedron()),
        ("cube", cube()),
        ("two cubes in one place", twice),
        ("sphere", sphere(12)),
        ("rough sphere", sphere(16).shaken(0.02, 5)),
        ("very rough sphere", sphere(12).shaken(0.1, 9)),
        ("torus", torus(40, 16, 0.35)),
        ("sheet", sheet(5)),
        ("ramp", ramp()),
        ("spiral", spiral()),
        ("moebius strip", moebius),
        ("parts", sphere(4).moved(far(3.0)).and(cube()).and(sheet(3).moved(far(-4.0)))),
        ("thin", torus(24, 8, 0.3).moved(|point| point * DVec3::new(1.0, 1.0, 0.01))),
        ("huge", sphere(6).moved(|point| point * 1e200)),
        ("tiny", sphere(6).moved(|point| point * 1e-200)),
    ]
}

fn made(model: &Model, options: &AtlasOptions) -> Atlas<f64> {
    atlas(&model.positions(), &model.mesh(), options).unwrap()
}

fn each(mut law: impl FnMut(&str, &Model, &Atlas<f64>)) {
    for (name, model) in models() {
        law(name, &model, &made(&model, &AtlasOptions::new(SIZE)));
    }
}

/// The corners of a face in texels.
fn in_texels(atlas: &Atlas<f64>, face: usize) -> [DVec3; 3] {
    atlas.corners.faces()[face].map(|row| {
        let at = |axis| atlas.coordinates[[row as usize, axis]] * atlas.size as f64;
        DVec3::new(at(0), at(1), 0.0)
    })
}

#[test]
fn each_corner_has_coordinates_of_its_vertex_inside_the_texture() {
    each(|name, model, atlas| {
        assert!(atlas.coordinates.data().iter().all(|x| (0.0..=1.0).contains(x)), "{name}");
        for (face, rows) in model.faces.iter().zip(atlas.corners.faces()) {
            assert_eq!(rows.map(|row| atlas.vertices[row as usize]), *face, "{name}");
        }
        assert!(atlas.chart_of.iter().all(Option::is_some), "{name}");
        let charts = atlas.chart_of.iter().flatten().max().unwrap() + 1;
        assert_eq!(charts as usize, atlas.charts, "{name}");
        // Of one chart faces that share a vertex share its coordinates.
        let mut pairs: Vec<_> = (0..model.faces.len())
            .flat_map(|face| (0..3).map(move |corner| (face, corner)))
            .map(|(face, corner)| {
                let [vertex, row] =
                    [model.faces[face][corner], atlas.corners.faces()[face][corner]];
                ((atlas.chart_of[face], vertex), row)
            })
            .collect();
        pairs.sort_unstable();
        pairs.dedup();
        assert!(pairs.windows(2).all(|pair| pair[0].0 != pair[1].0), "{name}");
    });
}

#[test]
fn no_texel_is_of_two_faces_and_no_gutter_of_two_charts() {
    let mut wide = 0;
    each(|name, model, atlas| {
        wide += usize::from(atlas.levels == 2);
        let reach = reach(atlas.levels);
        let mut charts: Vec<Option<u32>> = vec![None; SIZE * SIZE];
        let mut is_shown = vec![false; SIZE * SIZE];
        for face in 0..model.faces.len() {
            let corners = in_texels(atlas, face);
            // Texture coordinates run as the texture is seen from the front.
            assert!(area_vector(corners).z < 0.0, "{name} {face}");
            let [low, high] = [
                corners[0].min(corners[1]).min(corners[2]) - reach,
                corners[0].max(corners[1]).max(corners[2]) + reach,
            ];
            assert!(low.min_element() > -reach - 1e-9 && high.x.max(high.y) < SIZE as f64 + reach);
            for texel in 0..SIZE * SIZE {
                let middle =
                    DVec3::new((texel % SIZE) as f64 + 0.5, (texel / SIZE) as f64 + 0.5, 0.0);
                if middle.cmplt(low.with_z(-1.0)).any() || middle.cmpgt(high.with_z(1.0)).any() {
                    continue;
                }
                let (weights, square) = nearest(corners, middle);
                if weights.iter().all(|weight| *weight > 1e-6) && square < 1e-18 {
                    assert!(
                        !is_shown[texel],
                        "{name}: texel {texel} is of face {face} and another"
                    );
                    is_shown[texel] = true;
                }
                let point: DVec3 = (0..3).map(|k| weights[k] * corners[k]).sum();
                if (point - middle).abs().max_element() < reach - 1e-9 {
                    let chart = atlas.chart_of[face];
                    let own = charts[texel].get_or_insert(chart.unwrap());
                    assert_eq!(Some(*own), chart, "{name}: texel {texel}");
                }
            }
        }
    });
    assert!(wide >= 8, "{wide} atlases with all levels");
}

#[test]
fn faces_of_one_chart_that_share_texels_are_near_in_space() {
    let mut pairs = 0;
    each(|name, model, atlas| {
        let unit = model.points.iter().fold(0.0_f64, |it, point| it.max(point.abs().max_element()));
        let in_space = |face: usize| model.faces[face].map(|at| model.points[at as usize] / unit);
        let areas = |corners: &dyn Fn(usize) -> [DVec3; 3]| {
            let areas =
                (0..model.faces.len()).map(|face| 0.5 * area_vector(corners(face)).length());
            areas.sum::<f64>()
        };
        let texel = (areas(&in_space) / areas(&|face| in_texels(atlas, face))).sqrt();
        let assumed = (areas(&in_space) / COVERED).sqrt() / SIZE as f64;
        let reach = reach(atlas.levels);
        // Beside and above: faces are at most as far apart as their charts allow.
        let most = 5_f64.sqrt() * reach * assumed.max(1.3 * texel);
        for (one, other) in
            (0..model.faces.len()).flat_map(|one| (0..model.faces.len()).map(move |it| (one, it)))
        {
            if atlas.chart_of[one] != atlas.chart_of[other]
                || in_space(one).iter().any(|corner| in_space(other).contains(corner))
            {
                continue;
            }
            let to = in_texels(atlas, other);
            for (at, corner) in in_texels(atlas, one).into_iter().zip(in_space(one)) {
                let away = (to[0].min(to[1]).min(to[2]) - at).max(at - to[0].max(to[1]).max(to[2]));
                if away.max_element() >= reach {
                    continue;
                }
                let (weights, square) = nearest(to, at);
                if square < (reach * reach) {
                    let point: DVec3 = (0..3).map(|k| weights[k] * in_space(other)[k]).sum();
                    let distance = corner.distance(point);
                    assert!(distance <= most, "{name}: {one} {other}: {distance} and not {most}");
                    pairs += 1;
                }
            }
        }
    });
    assert!(pairs > 1000, "{pairs}");
}

#[test]
fn texels_are_as_dense_everywhere_to_within_the_cone() {
    for cone in [20.0_f64, 50.0, 80.0] {
        for (name, model) in models() {
            // More charts need more room.
            let options = AtlasOptions { cone, ..AtlasOptions::new(4 * SIZE) };
            let atlas = made(&model, &options);
            let size = model.points.iter().fold(0.0_f64, |size, p| size.max(p.abs().max_element()));
            let density = |face: usize| {
                let corners = model.faces[face].map(|vertex| model.points[vertex as usize] / size);
                area_vector(in_texels(&atlas, face)).length() / area_vector(corners).length()
            };
            let all: Vec<_> = (0..model.faces.len()).map(density).collect();
            let [least, most] = [f64::INFINITY, 0.0].map(|start: f64| {
                all.iter().fold(start, |it, x| if start > 0.0 { it.min(*x) } else { it.max(*x) })
            });
            assert!(
                least / most >= cone.to_radians().cos() - 1e-9,
                "{name} {cone}: {least} {most}"
            );
        }
    }
}

/// A colour that grows along x, y and z from 0 to 1.
fn linear(model: &Model) -> Tensor<f64> {
    let [low, high] = [f64::INFINITY, f64::NEG_INFINITY].map(|start| {
        let fold = |it: f64, x: f64| if start > 0.0 { it.min(x) } else { it.max(x) };
        model.points.iter().flat_map(|point| point.to_array()).fold(start, fold)
    });
    model.positions().map(|x| (x - low) / (high - low))
}

#[test]
fn a_linear_colour_is_found_again_on_the_surface_at_each_safe_level() {
    each(|name, model, atlas| {
        let colors = linear(model);
        let map = TexelMap::new(&atlas.coordinates, &atlas.corners, SIZE).unwrap();
        let texels = map.bake(&colors, &model.mesh()).unwrap();
        let drawn = draw_points(&model.positions(), &model.mesh(), 4000, 3).unwrap();
        let tape = Tape::new();
        // Colours of the same points.
        let expected = drawn.interpolate(tape.constant(&colors)).unwrap().value();
        let corners = drawn.faces().iter().map(|face| atlas.corners.faces()[*face as usize]);
        let corners: Vec<_> = corners.collect();
        let at = Tensor::from_fn([corners.len(), 2], |[row, axis]| {
            let weights = drawn.barycentrics()[row];
            (0..3).map(|k| weights[k] * atlas.coordinates[[corners[row][k] as usize, axis]]).sum()
        });
        // A texel's change: an atlas has texels of one size.
        let change = (0..model.faces.len())
            .map(|face| {
                let [a, b, c] = in_texels(atlas, face);
                let rows = model.faces[face].map(|vertex| {
                    DVec3::from_array([0, 1, 2].map(|k| colors[[vertex as usize, k]]))
                });
                // The gradient of the colour in texels: both edges are sums of it.
                let (across, turned) = (b - a, c - a);
                let area = across.cross(turned).z;
                let [du, dv] = [
                    (rows[1] - rows[0]) * turned.y - (rows[2] - rows[0]) * across.y,
                    (rows[2] - rows[0]) * across.x - (rows[1] - rows[0]) * turned.x,
                ]
                .map(|sum| (sum / area).abs().max_element());
                du + dv
            })
            .fold(0.0, f64::max);
        let texture = Texture::with_mipmaps(tape.constant(&texels)).unwrap();
        for level in 0..=atlas.levels {
            let sampler = Sampler::new().filter(TextureFilter::Trilinear);
            let sampler = sampler.border(TextureBorder::Clamp);
            let detail = Detail::Level(tape.constant_scalar(level as f64));
            let found = sample_texture(&texture, tape.constant(&at), detail, sampler).unwrap();
            let found = found.value();
            let off = found.data().iter().zip(expected.data());
            let off = off.fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
            let allowed = change * reach(level);
            assert!(off < allowed, "{name}, level {level}: {off}, and not {allowed}");
        }
    });
}

#[test]
fn faces_without_an_area_have_a_place_and_no_chart() {
    let mut model = sphere(3);
    let count = model.faces.len();
    // Vertices of the sphere, and one of its own.
    model.points.push(DVec3::splat(4.0));
    let own = model.points.len() as u32 - 1;
    model.faces.extend([[0, 0, 1], [own, own, own], [2, 1, 2]]);
    let atlas = made(&model, &AtlasOptions::new(64));
    assert_eq!(atlas.chart_of[count..], [None; 3]);
    assert!(atlas.chart_of[..count].iter().all(Option::is_some));
    let rows = atlas.corners.faces()[count + 1];
    assert_eq!(rows, [rows[0]; 3]);
    assert_eq!([0, 1].map(|axis| atlas.coordinates[[rows[0] as usize, axis]]), [0.0; 2]);
    for rows in &atlas.corners.faces()[count..] {
        rows.iter().for_each(|row| assert!((*row as usize) < atlas.vertices.len()));
    }
    // Nothing at all.
    let empty = Model { points: vec![DVec3::ONE; 2], faces: Vec::new() };
    let none = made(&empty, &AtlasOptions::new(4));
    assert_eq!((none.charts, none.vertices.len(), none.corners.faces().len()), (0, 0, 0));
    let map = TexelMap::new(&none.coordinates, &none.corners, 4).unwrap();
    let texels = map.bake(&Tensor::full([2, 3], 7.0), &empty.mesh()).unwrap();
    assert_eq!(texels, Tensor::zeros([4, 4, 3]));
    let flat = Model { faces: vec![[0, 1, 0]], ..empty };
    assert_eq!(made(&flat, &AtlasOptions::new(4)).charts, 0);
}

#[test]
fn texels_show_the_nearest_point_and_those_beyond_a_chart_are_copies_of_its_border() {
    let model = sphere(5);
    let atlas = made(&model, &AtlasOptions::new(64));
    let faces: Vec<_> = (0..model.faces.len()).map(|face| in_texels(&atlas, face)).collect();
    let map = TexelMap::new(&atlas.coordinates, &atlas.corners, 64).unwrap();
    for (texel, &source) in map.sources().iter().enumerate() {
        let is_own = map.point(texel / 64, texel % 64).is_some();
        assert_eq!(is_own, source as usize == texel);
        if let Some((face, weights)) = map.point(texel / 64, texel % 64) {
            // No face has a nearer one.
            let middle = DVec3::new((texel % 64) as f64 + 0.5, (texel / 64) as f64 + 0.5, 0.0);
            let least = faces.iter().map(|corners| nearest(*corners, middle).1);
            let point: DVec3 = (0..3).map(|k| weights[k] * faces[face as usize][k]).sum();
            let least = least.fold(f64::INFINITY, f64::min);
            assert!((point.distance_squared(middle) - least).abs() < 1e-9, "texel {texel}");
        }
        assert!(map.point(source as usize / 64, source as usize % 64).is_some());
    }
    let copies = map.sources().iter().zip(0..).filter(|(source, texel)| *source != texel).count();
    assert!((500..3500).contains(&copies), "{copies}");
}

#[test]
fn charts_are_few_and_cover_much() {
    let covered = |model: &Model| {
        let atlas = made(model, &AtlasOptions::new(512));
        let area: f64 = (0..model.faces.len())
            .map(|face| 0.5 * area_vector(in_texels(&atlas, face)).length())
            .sum();
        (atlas.charts, area / (512.0 * 512.0))
    };
    let (charts, share) = covered(&sphere(30));
    assert!(charts <= 16 && share > 0.5, "{charts} {share}");
    let (charts, share) = covered(&cube());
    assert!(charts <= 6 && share > 0.6, "{charts} {share}");
    let (charts, share) = covered(&sheet(4));
    assert!(charts == 1 && share > 0.9, "{charts} {share}");
}

#[test]
fn thin_surfaces_are_as_long_as_the_texture() {
    let needle = [[0.0, 0.0], [1.0, 0.0], [0.0, 1e-7]];
    // The box around both slivers is 10^12 times as large as they are.
    let least = 1e-12;
    let corner = [[0.0, 0.0], [1.0, 0.0], [least, least], [0.0, 1.0]];
    for (points, faces) in
        [(&needle[..], vec![[0, 1, 2]]), (&corner[..], vec![[0, 1, 2], [0, 2, 3]])]
    {
        let points = points.iter().map(|[x, y]| DVec3::new(*x, *y, 0.0)).collect();
        let model = Model { points, faces };
        for size in [16, SIZE, 1 << 14] {
            let atlas = made(&model, &AtlasOptions::new(size));
            assert_eq!((atlas.charts, atlas.levels), (1, 0));
            let [from, to] = [0, 1].map(|vertex| {
                let row = atlas.vertices.iter().position(|it| *it == vertex).unwrap();
                DVec3::new(atlas.coordinates[[row, 0]], atlas.coordinates[[row, 1]], 0.0)
            });
            // But for the gutters, and half of it where the longest side lies aslant.
            let length = from.distance(to) * size as f64;
            assert!(length > 0.45 * (size as f64 - 3.0), "{length}");
        }
    }
}

#[test]
fn where_gutters_have_no_room_levels_are_fewer_and_then_it_is_refused() {
    let model = sphere(8).shaken(0.1, 2);
    assert_eq!([32, 64, 1024].map(|size| made(&model, &AtlasOptions::new(size)).levels), [0, 0, 2]);
    let error = super::atlas(&model.positions(), &model.mesh(), &AtlasOptions::new(4)).unwrap_err();
    assert!(matches!(error, MeshError::AtlasSize { size: 4, .. }), "{error}");
    let refused = |options: AtlasOptions, rule: &str| {
        let error = super::atlas(&model.positions(), &model.mesh(), &options).unwrap_err();
        assert!(error.to_string().contains(rule), "{error}");
    };
    refused(AtlasOptions::new(0), "a size from 1 to 2^14, got 0");
    refused(AtlasOptions::new((1 << 14) + 1), "a size from 1 to 2^14");
    for cone in [0.0, 90.0, f64::NAN] {
        refused(
            AtlasOptions { cone, ..AtlasOptions::new(8) },
            "a cone above 0 and below 90 degrees",
        );
    }
}

#[test]
fn maps_of_what_is_no_texture_are_refused() {
    let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
    let new = |shape: [usize; 2], value: f64, size| {
        TexelMap::new(&Tensor::full(shape, value), &mesh, size).unwrap_err().to_string()
    };
    assert!(new([2, 2], 0.0, 8).contains("coordinates of shape [3, 2], got shape [2, 2]"));
    assert!(new([3, 2], f64::NAN, 8).contains("finite coordinates, got NaN"));
    assert!(new([3, 2], 0.0, 0).contains("a size from 1 to 2^14, got 0"));
    let far = Tensor::from_flat_fn([3, 2], |k| [1e300, -1e300, 2.0, 5.0, -4.0, 0.5][k]);
    let map = TexelMap::new(&far, &mesh, 8).unwrap();
    let refused = |values: &Tensor<f64>| map.bake(values, &mesh).unwrap_err();
    let shape = |error: &MeshError| matches!(error, MeshError::Tensor(TensorError::Shape { .. }));
    assert!(shape(&refused(&Tensor::zeros([2, 3]))));
    assert!(shape(&refused(&Tensor::zeros([3]))));
    assert_eq!(**map.bake(&Tensor::<f64>::zeros([3, 0]), &mesh).unwrap().shape(), [8, 8, 0]);
}
