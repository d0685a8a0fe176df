//! Normals of meshes of any size and shape.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Mesh, RenderError, Weighting, face_normals, perturbed_normals, tangents, transform_normals,
    vertex_normals,
};

use super::row::{Failure, Found, Outcome, told};
use super::scene::{difference, largest, motley, numbers, rounding};

/// Normals as an operation on positions.
type Normals<T> = for<'t> fn(Var<'t, T>, &Mesh) -> Result<Var<'t, T>, RenderError>;

/// Every kind of normal, and its name on the tape.
fn kinds<T: Scalar>() -> [(&'static str, Normals<T>); 3] {
    [
        ("face_normals", |positions, mesh| face_normals(positions, mesh)),
        ("vertex_normals", |positions, mesh| vertex_normals(positions, mesh, Weighting::Area)),
        ("vertex_normals", |positions, mesh| vertex_normals(positions, mesh, Weighting::Angle)),
    ]
}

/// Normals, and gradients for motley upstream.
fn run<T: Scalar>(
    normals: Normals<T>,
    positions: &[f64],
    faces: &[[u32; 3]],
) -> Result<[Vec<f64>; 2], Failure> {
    let tape = Tape::<T>::new();
    let count = positions.len() / 3;
    let mesh = Mesh::new(faces.to_vec(), count)?;
    let positions = tape.leaf(&Tensor::from_flat_fn([count, 3], |k| T::from_f64(positions[k])));
    let out = normals(positions, &mesh)?;
    let upstream = Tensor::from_flat_fn(out.shape(), |k| T::from_f64(motley(3 * k + 1)));
    let gradients = tape.vjp(&[(out, &upstream)])?;
    Ok([numbers(&out.value()), numbers(&gradients.get_or_zeros(positions))])
}

/// A bent sheet of 6 x 6 quads, with coordinates that `T` holds.
fn sheet<T: Scalar>() -> (Vec<f64>, Vec<[u32; 3]>) {
    let (mut positions, mut faces) = (Vec::new(), Vec::new());
    for k in 0..49_u32 {
        let [x, y] = [k % 7, k / 7].map(|at| f64::from(at) / 6.0);
        positions.extend([x, y, (3.0 * x).sin() * y].map(|at| T::from_f64(at).to_f64()));
        if k % 7 < 6 && k / 7 < 6 {
            faces.extend([[k, k + 1, k + 8], [k, k + 8, k + 7]]);
        }
    }
    (positions, faces)
}

pub(super) fn without_an_area<T: Scalar>() -> Outcome {
    let (mut positions, mut faces) = sheet::<T>();
    // Four vertices more, on a line and in one place; each degenerate face also touches the sheet or
    // names a vertex twice.
    positions.extend([3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 9.0, 12.0, 15.0, 9.0, 12.0, 15.0]);
    let flat = [[49, 50, 51], [51, 50, 49], [0, 51, 52], [0, 0, 7], [8, 8, 8], [49, 52, 52]];
    let mut wrong = 0;
    for size in [-50, 0, 50].map(|power| f64::powi(2.0, power)) {
        let scaled: Vec<f64> = positions.iter().map(|x| size * x).collect();
        let (proper, mut all) = (faces.clone(), flat.to_vec());
        all.extend(&faces);
        for (k, (_, normals)) in kinds::<T>().into_iter().enumerate() {
            let [expected, _] = run(normals, &scaled, &proper)?;
            let [found, bars] = run(normals, &scaled, &all)?;
            let zeros = if k == 0 { flat.len() * 3 } else { 0 };
            let (none, rest) = found.split_at(zeros);
            wrong += none.iter().filter(|&&entry| entry != 0.0).count();
            wrong += usize::from(rest != expected);
            // The vertices that no proper face has.
            wrong += bars[147..].iter().filter(|&&bar| bar != 0.0).count();
        }
    }
    faces.clear();
    for (_, normals) in kinds::<T>() {
        let [found, bars] = run(normals, &positions, &faces)?;
        wrong += found.iter().chain(&bars).filter(|&&entry| entry != 0.0).count();
    }
    Ok(Found::exactly("zero vectors, zero gradients, the other normals as without", wrong))
}

pub(super) fn any_size<T: Scalar>() -> Outcome {
    let (positions, faces) = sheet::<T>();
    // Far beyond 1e-30 to 1e30, and 1e-15 to 1e15 in f32.
    let most = if rounding::<T>() < 1e-10 { 900 } else { 80 };
    let mut wrong = 0;
    for (_, normals) in kinds::<T>() {
        let [expected, expected_bars] = run(normals, &positions, &faces)?;
        for power in [-most, -50, 1, 50, most] {
            let scale = f64::powi(2.0, power);
            let scaled: Vec<f64> = positions.iter().map(|x| scale * x).collect();
            let [found, bars] = run(normals, &scaled, &faces)?;
            let is_same = bars.iter().zip(&expected_bars).all(|(bar, other)| scale * bar == *other);
            wrong += usize::from(found != expected) + usize::from(!is_same);
        }
    }
    Ok(Found::exactly("the same normals, gradients times 2^-k", wrong))
}

pub(super) fn no_normal<T: Scalar>() -> Outcome {
    let (positions, mut faces) = sheet::<T>();
    // The back of every face, with the corners in another order.
    let back: Vec<[u32; 3]> = faces.iter().rev().map(|&[a, b, c]| [a, c, b]).collect();
    faces.extend(back);
    let mut wrong = 0;
    for (_, normals) in &kinds::<T>()[1..] {
        for faces in [&faces[..], &[]] {
            let [found, bars] = run(*normals, &positions, faces)?;
            wrong += found.iter().chain(&bars).filter(|&&entry| entry != 0.0).count();
        }
    }
    Ok(Found::exactly("zero vectors, zero gradients", wrong))
}

pub(super) fn needles<T: Scalar>() -> Outcome {
    // In the plane through the origin with normal (1, 2, 2) / 3, on whole numbers and halves: exact.
    let (u, v, plane) = ([2.0, -2.0, 1.0], [2.0, 1.0, -2.0], [1.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0]);
    let mut error = 0.0_f64;
    for power in [-10, -20, -23] {
        let width = f64::powi(2.0, power);
        let at = |s: f64, t: f64| [0, 1, 2].map(|i| s * u[i] + t * v[i]);
        // A needle whose tip is the first, the second, the third corner; a cap; and a fan of both.
        let corners = [at(0.0, 0.0), at(1.0, 0.0), at(1.0, width), at(0.5, -width)];
        let positions = corners.concat();
        for faces in
            [&[[0, 1, 2]][..], &[[2, 0, 1]], &[[1, 2, 0]], &[[0, 3, 1]], &[[0, 1, 2], [0, 3, 1]]]
        {
            for (_, normals) in kinds::<T>() {
                let [found, bars] = run(normals, &positions, faces)?;
                for normal in found.chunks(3).filter(|normal| normal.iter().any(|&x| x != 0.0)) {
                    error = error.maximum_or_nan(difference(normal, &plane));
                }
                // The true gradient of a width of 1e-7 is 1e7.
                error = error.maximum_or_nan(0.0 * largest(bars));
            }
        }
    }
    Ok(Found::within("the normal of the plane they lie in", error, 4.0 * rounding::<T>()))
}

pub(super) fn refused<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let (_, faces) = sheet::<T>();
    let mesh = Mesh::new(faces, 49)?;
    let mut results = Vec::new();
    for (name, normals) in kinds::<T>() {
        for shape in [&[48, 3][..], &[49, 4], &[147], &[]] {
            let said = told(normals(tape.leaf(&Tensor::zeros(shape)), &mesh));
            let rule = "needs positions of shape [49, 3], got shape";
            results.push((said, format!("{name} {rule} {shape:?}")));
        }
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let entry = |k: usize| T::from_f64(if k == 100 { bad } else { 0.5 });
            let said = told(normals(tape.leaf(&Tensor::from_flat_fn([49, 3], entry)), &mesh));
            let rule = "needs finite numbers in row 33 of the positions, got";
            results.push((said, format!("{name} {rule} {bad}")));
        }
    }
    let zeros = |shape: &[usize]| tape.leaf(&Tensor::zeros(shape));
    for shape in [&[4, 2][..], &[]] {
        let said = told(transform_normals(zeros(shape), zeros(&[3, 3])));
        let rule = "transform_normals needs normals of shape [.., 3], got shape";
        results.push((said, format!("{rule} {shape:?}")));
    }
    for shape in [&[3, 4][..], &[4, 3], &[9], &[]] {
        let said = told(transform_normals(zeros(&[2, 3]), zeros(shape)));
        let rule = "transform_normals needs a matrix of shape [4, 4] or [3, 3], got shape";
        results.push((said, format!("{rule} {shape:?}")));
    }
    let upright = zeros(&[49, 3]);
    let flat = zeros(&[49, 2]);
    let textured = |p, n, c, indices: &Mesh| told(tangents(p, n, c, indices, &mesh));
    for (name, [p, n], c, rule) in [
        ("positions", [flat, upright], flat, "[49, 3], got shape [49, 2]"),
        ("normals", [upright, flat], flat, "[49, 3], got shape [49, 2]"),
        ("texture coordinates", [upright; 2], upright, "[49, 2], got shape [49, 3]"),
    ] {
        let message = format!("tangents needs {name} of shape {rule}");
        results.push((textured(p, n, c, &mesh), message));
    }
    let few = Mesh::new(vec![[0, 1, 2]], 49)?;
    let rule = "indices need one face per face of the mesh, 72, got 1";
    results.push((textured(upright, upright, flat, &few), rule.to_owned()));
    let shared = Mesh::new(vec![[0, 1, 2]; 72], 3)?;
    let rule = "tangents needs texture coordinate 1 at no vertex but 1, got 8";
    results.push((textured(upright, upright, zeros(&[3, 2]), &shared), rule.to_owned()));
    let perturbed =
        |[n, t, v]: [&[usize]; 3]| told(perturbed_normals(zeros(n), zeros(t), zeros(v)));
    for (shapes, rule) in [
        ([&[4, 2][..], &[4, 4], &[4, 3]], "normals of shape [.., 3], got shape [4, 2]"),
        ([&[4, 3], &[4, 3], &[4, 3]], "tangents of shape [4, 4], got shape [4, 3]"),
        ([&[4, 3], &[4, 4], &[3, 3]], "map values of shape [4, 3], got shape [3, 3]"),
    ] {
        results.push((perturbed(shapes), format!("perturbed_normals needs {rule}")));
    }
    Ok(Found::refused(results))
}

pub(super) fn transformed<T: Scalar>() -> Outcome {
    let (positions, faces) = sheet::<T>();
    let mesh = Mesh::new(faces, 49)?;
    // A mirror; onto a plane; onto a line; onto a point; and one that squeezes by 2^-40.
    let squeeze = f64::powi(2.0, -40);
    let matrices = [
        [-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        [0.5, 0.5, 0.0, 0.5, 0.5, 0.0, 0.0, 0.0, 1.0],
        [1.0, 2.0, 3.0, 2.0, 4.0, 6.0, -1.0, -2.0, -3.0],
        [0.0; 9],
        [1.0, 0.0, 0.0, 0.0, squeeze, 0.0, 0.0, 0.0, 1.0],
    ];
    let (mut error, mut finite) = (0.0_f64, true);
    for (matrix, power) in matrices.iter().flat_map(|matrix| [-60, 0, 60].map(|k| (matrix, k))) {
        let tape = Tape::<T>::new();
        let at = tape.leaf(&Tensor::from_flat_fn([49, 3], |k| T::from_f64(positions[k])));
        // In f64, as the images of points are not points that f32 has.
        let there = Tape::<f64>::new();
        let image = |k: usize| -> f64 {
            (0..3).map(|j| matrix[k % 3 * 3 + j] * positions[k / 3 * 3 + j]).sum()
        };
        let image = there.leaf(&Tensor::from_flat_fn([49, 3], image));
        let expected = numbers(&face_normals(image, &mesh)?.value());
        let scale = f64::powi(2.0, power);
        let matrix = tape.leaf(&Tensor::from_flat_fn([3, 3], |k| T::from_f64(scale * matrix[k])));
        let found = transform_normals(face_normals(at, &mesh)?, matrix)?;
        error = error.maximum_or_nan(difference(&numbers(&found.value()), &expected));
        let gradients = found.sum().backward()?;
        finite &= [at, matrix].iter().all(|&leaf| gradients.get_or_zeros(leaf).is_finite());
    }
    // The normals before are rounded.
    Ok(Found::within("the normals of the transformed faces", error, 32.0 * rounding::<T>())
        .and(finite, "a gradient is not finite"))
}

/// Tangents of the sheet, and gradients of positions, normals and coordinates for motley upstream.
fn run_tangents<T: Scalar>(inputs: [&[f64]; 3]) -> Result<[Vec<f64>; 4], Failure> {
    let tape = Tape::<T>::new();
    let mesh = Mesh::new(sheet::<T>().1, 49)?;
    let leaf =
        |of: &[f64]| tape.leaf(&Tensor::from_flat_fn([49, of.len() / 49], |k| T::from_f64(of[k])));
    let [positions, normals, coordinates] = inputs.map(leaf);
    let out = tangents(positions, normals, coordinates, &mesh, &mesh)?;
    let upstream = Tensor::from_flat_fn(out.shape(), |k| T::from_f64(motley(3 * k + 1)));
    let gradients = tape.vjp(&[(out, &upstream)])?;
    let [p, n, c] = [positions, normals, coordinates].map(|leaf| gradients.get_or_zeros(leaf));
    Ok([numbers(&out.value()), numbers(&p), numbers(&n), numbers(&c)])
}

/// Normals and texture coordinates of the sheet, as `T` holds them.
fn texture<T: Scalar>(positions: &[f64]) -> [Vec<f64>; 2] {
    let single = |x: f64| T::from_f64(x).to_f64();
    let normals = (0..147).map(|k| single(if k % 3 == 2 { 1.0 } else { 0.4 * motley(k) }));
    let coordinate = |k: usize| {
        let [x, y] = [positions[k / 2 * 3], positions[k / 2 * 3 + 1]];
        if k.is_multiple_of(2) { x + 0.2 * y } else { 0.9 - 0.8 * y + 0.1 * x }
    };
    [normals.collect(), (0..98).map(|k| single(coordinate(k))).collect()]
}

pub(super) fn no_tangent<T: Scalar>() -> Outcome {
    let (positions, _) = sheet::<T>();
    let [normals, coordinates] = texture::<T>(&positions);
    let line: Vec<f64> = (0..98).map(|k| f64::from(1 + k % 2) * (k / 2 % 7) as f64).collect();
    let all_in_one = vec![0.3; 98];
    let (flat, gone) = (vec![0.5; 147], vec![0.0; 147]);
    let along_x: Vec<f64> =
        positions.iter().enumerate().map(|(k, x)| if k % 3 == 0 { *x } else { 0.0 }).collect();
    let mut wrong = 0;
    for inputs in [
        [&positions[..], &normals, &all_in_one],
        [&positions, &normals, &line],
        [&positions, &gone, &coordinates],
        [&flat, &normals, &coordinates],
        [&along_x, &normals, &coordinates],
    ] {
        let [found, bars @ ..] = run_tangents::<T>(inputs)?;
        let right = |(k, entry): (usize, &f64)| *entry == f64::from(u8::from(k % 4 == 3));
        wrong += found.iter().enumerate().filter(|&entry| !right(entry)).count();
        wrong += bars.iter().flatten().filter(|&&bar| bar != 0.0).count();
    }
    Ok(Found::exactly("(0, 0, 0, 1), zero gradients", wrong))
}

pub(super) fn tangents_of_any_size<T: Scalar>() -> Outcome {
    let (positions, _) = sheet::<T>();
    let [normals, coordinates] = texture::<T>(&positions);
    let [expected, expected_bars @ ..] = run_tangents::<T>([&positions, &normals, &coordinates])?;
    let most = if rounding::<T>() < 1e-10 { 800 } else { 60 };
    let mut wrong = 0;
    for powers in [[most, -most, most], [-most, 3, -most], [0, most, 1]] {
        let scales = powers.map(|power| f64::powi(2.0, power));
        let scaled = |of: &[f64], input: usize| -> Vec<f64> {
            of.iter().map(|x| scales[input] * x).collect()
        };
        let [p, n, c] = [scaled(&positions, 0), scaled(&normals, 1), scaled(&coordinates, 2)];
        let [found, bars @ ..] = run_tangents::<T>([&p, &n, &c])?;
        wrong += usize::from(found != expected);
        for input in 0..3 {
            wrong += usize::from(scaled(&bars[input], input) != expected_bars[input]);
        }
        wrong += bars[2].iter().step_by(2).filter(|&&bar| bar != 0.0).count();
    }
    // Where v stays u grows, whatever is added to u along v.
    let shear = |(k, c): (usize, &f64)| if k % 2 == 0 { c + 0.5 * coordinates[k + 1] } else { *c };
    let sheared: Vec<f64> = coordinates.iter().enumerate().map(shear).collect();
    let [found, ..] = run_tangents::<T>([&positions, &normals, &sheared])?;
    wrong += usize::from(found != expected);
    Ok(Found::exactly("the same tangents, gradients times 2^-k", wrong))
}

pub(super) fn perturbed<T: Scalar>() -> Outcome {
    let normal = [0.5, -0.25, 2.0];
    let along = normal.map(|entry| -3.0 * entry);
    let unit = 1.0 / (normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]).sqrt();
    let upright = normal.map(|entry| unit * entry);
    let down = upright.map(|entry| -entry);
    let (zero, across) = ([0.0; 3], [1.0, 0.0, 0.0]);
    // Normal, tangent and map value; what comes out.
    let table = [
        (normal, zero, [0.3, -0.5, 0.7], upright),
        (normal, along, [0.3, -0.5, -0.7], upright),
        (normal, along, zero, upright),
        (normal, across, [0.0, 0.0, 1e-30], upright),
        (normal, across, [0.0, 0.0, -1.0], down),
        (normal, across, zero, zero),
        (zero, across, [0.3, -0.5, 0.7], zero),
        (zero, zero, zero, zero),
    ];
    let mut error = 0.0_f64;
    let mut finite = true;
    for (normal, [x, y, z], value, expected) in table {
        for (scale, sign) in [(1.0, 1.0), (1e-30, -1.0), (1e30, -0.0)] {
            let tape = Tape::<T>::new();
            let leaf = |of: &[f64]| {
                tape.leaf(&Tensor::from_flat_fn([1, of.len()], |k| T::from_f64(of[k])))
            };
            let normal = leaf(&normal.map(|entry| scale * entry));
            let (tangent, value) = (leaf(&[scale * x, scale * y, scale * z, sign]), leaf(&value));
            let out = perturbed_normals(normal, tangent, value)?;
            error = error.maximum_or_nan(difference(&numbers(&out.value()), &expected));
            let gradients = out.sum().backward()?;
            let leaves = [normal, tangent, value];
            finite &= leaves.iter().all(|&leaf| gradients.get_or_zeros(leaf).is_finite());
            let is_zero = expected == zero;
            let bars = leaves.iter().flat_map(|&leaf| numbers(&gradients.get_or_zeros(leaf)));
            finite &= !is_zero || bars.into_iter().all(|bar| bar == 0.0);
        }
    }
    Ok(Found::within("the unit normal, its opposite, or zero", error, 4.0 * rounding::<T>())
        .and(finite, "a gradient is not finite, or not zero"))
}
