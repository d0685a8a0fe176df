//! Which face is seen, and that nothing else tells faces, corners and scales apart.

use super::*;

#[test]
fn of_identical_faces_the_one_of_lower_index_is_seen() {
    let (clip, faces) = layered();
    let twice: Vec<_> = faces.iter().chain(&faces).copied().collect();
    for options in [WIDE, Size::square(1)] {
        let (once, twice) =
            (draw::<f32>(&clip, &faces, options), draw::<f32>(&clip, &twice, options));
        assert_eq!(once.pixels, twice.pixels);
    }
}

#[test]
fn a_hidden_face_changes_nothing() {
    let (mut clip, mut faces) = layered();
    let before = draw::<f32>(&clip, &faces, WIDE);
    // Behind the first face: the same corners, moved back.
    for corner in 0..3 {
        let [x, y, z, w] = clip[corner];
        clip.push([x, y, z + 0.05, w]);
    }
    faces.push([7, 8, 9]);
    assert_eq!(draw::<f32>(&clip, &faces, WIDE), before);
}

#[test]
fn permuting_the_faces_permutes_the_ids_and_nothing_else() {
    let (clip, faces) = layered();
    let order = [3, 0, 4, 2, 1];
    let permuted: Vec<_> = order.iter().map(|&face| faces[face]).collect();
    let mut drawn = draw::<f64>(&clip, &permuted, WIDE);
    for seen in drawn.pixels.iter_mut().flatten() {
        seen.face = order[seen.face as usize] as u32;
    }
    assert_eq!(drawn, draw::<f64>(&clip, &faces, WIDE));
}

#[test]
fn the_order_of_corners_moves_the_weights_and_nothing_else() {
    let (clip, faces) = layered();
    let plain = draw::<f64>(&clip, &faces, WIDE);
    for order in 0..6 {
        let turned: Vec<_> = faces.iter().map(|&face| orders(face)[order]).collect();
        let other = draw::<f64>(&clip, &turned, WIDE);
        assert_eq!(other.faces(), plain.faces());
        for (seen, plain) in other.pixels.iter().zip(&plain.pixels) {
            let (Some(seen), Some(plain)) = (seen, plain) else { continue };
            let weights = |[u, v]: [f64; 2]| [u, v, 1.0 - u - v];
            let (face, corners) = (faces[plain.face as usize], turned[plain.face as usize]);
            for (corner, weight) in corners.iter().zip(weights(seen.uv)) {
                let at = face.iter().position(|other| other == corner).unwrap();
                approx::assert_relative_eq!(weight, weights(plain.uv)[at], epsilon = 1e-13);
            }
            approx::assert_relative_eq!(seen.depth, plain.depth, epsilon = 1e-13);
        }
    }
}

#[test]
fn every_face_shows_its_front_or_its_back() {
    let (clip, faces) = layered();
    let drawn = |cull, face| draw::<f32>(&clip, &[face], RasterOptions::new(WIDE).cull(cull));
    for face in faces {
        let all = drawn(Cull::None, face);
        let [front, back] = [Cull::Back, Cull::Front].map(|cull| drawn(cull, face));
        assert_eq!(front.count() + back.count(), all.count());
        assert_eq!(front.culled.facing + back.culled.facing, 1);
        // The other winding shows the other side.
        let turned = drawn(Cull::Back, orders(face)[3]);
        assert_eq!(turned.faces(), back.faces());
    }
    // Counter-clockwise on the screen, y up, is the front.
    let clip = vec![[-1.0, -1.0, 0.0, 1.0], [1.0, -1.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0]];
    let options = RasterOptions::new(WIDE).cull(Cull::Back);
    assert!(draw::<f32>(&clip, &[[0, 1, 2]], options).count() > 0);
    assert_eq!(draw::<f32>(&clip, &[[0, 2, 1]], options).count(), 0);
}

#[test]
fn scaling_all_clip_positions_by_a_power_of_two_changes_no_bit() {
    let (clip, faces) = layered();
    let scaled = |factor: f64| -> Clip { clip.iter().map(|p| p.map(|c| c * factor)).collect() };
    let plain = draw::<f64>(&clip, &faces, WIDE);
    for exponent in [-1000, -300, -70, -1, 1, 70, 300, 1000] {
        let factor = 2.0_f64.powi(exponent);
        assert_eq!(draw::<f64>(&scaled(factor), &faces, WIDE), plain, "2^{exponent}");
        // The gradient has degree -1.
        let expected = gradient::<f64>(&clip, &faces, WIDE).into_iter().map(|entry| entry / factor);
        assert_eq!(
            gradient::<f64>(&scaled(factor), &faces, WIDE),
            expected.collect::<Vec<_>>(),
            "2^{exponent}"
        );
    }
    let plain = draw::<f32>(&clip, &faces, WIDE);
    for exponent in [-100, -50, 50, 120] {
        assert_eq!(draw::<f32>(&scaled(2.0_f64.powi(exponent)), &faces, WIDE), plain);
    }
}

#[test]
fn the_gradient_is_orthogonal_to_the_positions() {
    // Scaling a vertex's four coordinates by one factor for all changes nothing.
    let (clip, faces) = layered();
    let gradient = gradient::<f64>(&clip, &faces, WIDE);
    let terms = || gradient.iter().zip(clip.as_flattened()).map(|(bar, c)| bar * c);
    let size: f64 = terms().map(f64::abs).sum();
    assert!(size > 1.0 && terms().sum::<f64>().abs() < 1e-13 * size);
}

#[test]
fn of_identical_faces_the_one_of_lower_index_is_seen_on_edges_too() {
    // Two sides pass through pixel centres, which belong to the face.
    let size = Size::square(8);
    let px = [(1.5, 1.5), (6.5, 1.5), (1.5, 6.5)];
    let clip: Clip = px.iter().map(|&(x, y)| at_px(size, x, y)).collect();
    let once = draw::<f64>(&clip, &[[0, 1, 2]], size);
    assert!(once.faces()[9..14].iter().all(|&face| face == Some(0)));
    assert_eq!(draw::<f64>(&clip, &[[0, 1, 2], [0, 1, 2]], size), once);
}

#[test]
fn what_an_earlier_step_drew_is_forgotten() {
    // Pictures of several bands, some of one size, and sizes of as many pixels.
    let sizes = [[300, 200], [300, 200], [200, 300], [200, 300], [31, 22], [22, 31], [22, 31]];
    let mut tape = Tape::<f64>::new();
    let (clip, faces) = layered();
    let mesh = Mesh::new(faces.clone(), clip.len()).unwrap();
    for (step, [width, height]) in sizes.into_iter().enumerate() {
        let size = Size { width, height };
        let scale = [1.0, 0.4][step % 2];
        let smaller: Clip = clip.iter().map(|&[x, y, z, w]| [scale * x, scale * y, z, w]).collect();
        let fragments = rasterize(tape.leaf(&tensor(&smaller)), &mesh, size).unwrap();
        let expected = draw::<f64>(&smaller, &faces, size).faces();
        let found = (0..size.pixels()).map(|pixel| fragments.coverage.face_at(pixel));
        assert!(found.map(|face| face.map(|face| face as u32)).eq(expected), "step {step}");
        drop(fragments);
        tape.reset();
    }
}

#[test]
fn the_report_names_whole_rows_unless_a_face_that_is_drawn_reaches_behind_the_eye() {
    let clip = [[-0.5, -0.5, 0.0, 1.0], [0.5, -0.5, 0.0, 1.0], [0.0, 0.5, 0.0, -0.2]];
    for (w, is_left_out) in [(-0.2, false), (1.0, true)] {
        let clip = vec![clip[0], clip[1], [0.0, 0.5, 0.0, w]];
        for order in orders([0, 1, 2]) {
            let tape = Tape::<f64>::new();
            let mesh = Mesh::new(vec![order], 3).unwrap();
            rasterize(tape.leaf(&tensor(&clip)), &mesh, WIDE).unwrap();
            let left_out = tape.take_report().left_out;
            assert_eq!(left_out.iter().any(|entry| entry.name == "rasterize"), is_left_out);
        }
    }
}
