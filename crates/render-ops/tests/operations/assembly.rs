use bokashi_core::{Tape, Tensor, Var};
use bokashi_render_ops::{
    Assembly, Fragments, Mesh, Place, RenderError, Size, interpolate_indexed, rasterize,
};

fn triangle() -> Mesh {
    Mesh::new(vec![[0, 1, 2]], 3).unwrap()
}

fn square() -> Mesh {
    Mesh::new(vec![[0, 1, 2], [2, 1, 3]], 4).unwrap()
}

#[test]
fn every_face_and_every_vertex_is_of_one_instance() {
    let empty = Mesh::new(vec![], 2).unwrap();
    let parts = [(&empty, 2), (&triangle(), 2), (&square(), 0), (&empty, 1), (&square(), 3)];
    let assembly = Assembly::new(&parts).unwrap();
    assert_eq!((assembly.mesh().faces().len(), assembly.mesh().vertex_count()), (8, 24));
    let (mut face, mut vertex) = (0, 0);
    for (part, &(mesh, instances)) in parts.iter().enumerate() {
        for instance in 0..instances {
            let vertices = assembly.vertices(part, instance).unwrap();
            assert_eq!(vertices, vertex..vertex + mesh.vertex_count());
            for (k, corners) in mesh.faces().iter().enumerate() {
                assert_eq!(assembly.place(face), Some(Place { part, instance, face: k }));
                let expected = corners.map(|index| index + vertex as u32);
                assert_eq!(assembly.mesh().faces()[face], expected);
                face += 1;
            }
            vertex = vertices.end;
        }
        assert_eq!(assembly.vertices(part, instances), None);
    }
    assert_eq!((assembly.place(8), assembly.place(usize::MAX)), (None, None));
    assert_eq!((assembly.vertices(5, 0), assembly.vertices(4, usize::MAX)), (None, None));
    assert!(Assembly::new(&[]).unwrap().mesh().faces().is_empty());
}

#[test]
fn seams_and_neighbours_are_those_of_the_parts() {
    let marked = square().with_seams(|face, corner| (face, corner) == (0, 0));
    let assembly = Assembly::new(&[(&triangle(), 1), (&marked, 2), (&square(), 1)]).unwrap();
    let mesh = assembly.mesh();
    for face in 0..mesh.faces().len() {
        let Place { part, instance, face: local } = assembly.place(face).unwrap();
        let first = assembly.vertices(part, instance).unwrap().start as u32;
        let alone = &[triangle(), marked.clone(), square()][part];
        for corner in 0..3 {
            let across = alone.adjacency().across(local, corner).map(|vertex| vertex + first);
            assert_eq!(mesh.adjacency().across(face, corner), across);
            assert_eq!(mesh.is_seam(face, corner), alone.is_seam(local, corner));
        }
    }
    assert_eq!(mesh.adjacency().boundary_edges(), 3 + 3 * 4);
}

/// Two squares side by side, the second before a triangle that fills the image.
fn fragments<'t>(tape: &'t Tape<f64>, assembly: &Assembly) -> Fragments<'t, f64> {
    let back = [[-3.0, -1.0, 0.5, 1.0], [3.0, -1.0, 0.5, 1.0], [0.0, 9.0, 0.5, 1.0]];
    let square = |x: f64| {
        [[x, -0.5], [x + 0.6, -0.5], [x, 0.5], [x + 0.6, 0.5]].map(|[x, y]| [x, y, 0.0, 1.0])
    };
    let clip: Vec<_> = back.into_iter().chain(square(-0.8)).chain(square(0.2)).collect();
    rasterize(tape.leaf(&Tensor::from(clip)), assembly.mesh(), Size::square(12)).unwrap()
}

#[test]
fn instances_share_the_attributes_of_their_part_and_have_attributes_of_their_own() {
    let tape = Tape::new();
    let assembly = Assembly::new(&[(&triangle(), 1), (&square(), 2)]).unwrap();
    let fragments = fragments(&tape, &assembly);
    let places: Vec<_> =
        fragments.coverage.faces().map(|face| assembly.place(face).unwrap()).collect();
    let count = |part, instance| {
        places.iter().filter(|place| (place.part, place.instance) == (part, instance)).count()
    };
    assert!(count(0, 0) > 50 && count(1, 0) == 24 && count(1, 1) == 24, "{places:?}");

    // Three attributes of the triangle, then one for all corners of the square.
    let one = Mesh::new(vec![[0; 3], [0; 3]], 1).unwrap();
    let indices = assembly.attributes(&[&triangle(), &one]).unwrap();
    let shared = tape.leaf(&Tensor::new([4, 1], vec![2.0, 2.0, 2.0, 7.0]).unwrap());
    let values = interpolate_indexed(shared, &indices, &fragments).unwrap();
    let expected: Vec<_> = places.iter().map(|place| [2.0, 7.0][place.part]).collect();
    assert_eq!(values.value().data(), expected);
    let gradients = values.sum().backward().unwrap();
    approx::assert_relative_eq!(gradients.get(shared).unwrap().data()[3], 48.0, epsilon = 1e-12);

    let weights = tape.leaf(&Tensor::new([3, 1], vec![1.0, 3.0, 4.0]).unwrap());
    let values = interpolate_indexed(weights, &assembly.instances(), &fragments).unwrap();
    let expected: Vec<_> =
        places.iter().map(|place| [1.0, 3.0, 4.0][place.part + place.instance]).collect();
    assert_eq!(values.value().data(), expected);
}

#[test]
fn one_visibility_decides_between_parts_as_between_faces() {
    let tape = Tape::new();
    let assembly = Assembly::new(&[(&triangle(), 1), (&square(), 2)]).unwrap();
    let found = fragments(&tape, &assembly);
    let faces: Vec<_> = assembly.mesh().faces().to_vec();
    let by_hand = Mesh::new(faces, 11).unwrap();
    let expected = rasterize(found.clip, &by_hand, Size::square(12)).unwrap();
    assert_eq!(found.coverage.triangle_ids(), expected.coverage.triangle_ids());
    let (found, expected): (Vec<_>, Vec<_>) =
        [found, expected].map(|f| Var::value(f.barycentrics).data().to_vec()).into();
    assert_eq!(found, expected);
}

#[test]
fn what_cannot_be_is_refused_with_rule_and_value() {
    let said = |error: RenderError| error.to_string();
    let rule = "a mesh needs fewer than 2^31 faces and vertices, got";
    for (mesh, times) in
        [(square(), 1 << 30), (square(), usize::MAX), (Mesh::new(vec![], 0).unwrap(), usize::MAX)]
    {
        let error = said(Assembly::new(&[(&mesh, times)]).unwrap_err());
        assert!(error.starts_with(rule), "{error}");
    }
    let assembly = Assembly::new(&[(&triangle(), 1), (&square(), 2)]).unwrap();
    assert_eq!(
        said(assembly.attributes(&[&triangle()]).unwrap_err()),
        "attributes needs an index buffer for each of 2 parts, got 1 inputs"
    );
    assert_eq!(
        said(assembly.attributes(&[&triangle(), &triangle()]).unwrap_err()),
        "indices need one face per face of the mesh, 2, got 1"
    );
    let wide = Mesh::new(vec![[0; 3]], (1 << 31) - 1).unwrap();
    let pair = Assembly::new(&[(&triangle(), 1), (&triangle(), 1)]).unwrap();
    let error = said(pair.attributes(&[&wide, &wide]).unwrap_err());
    assert!(error.starts_with(rule), "{error}");
}
