use bokashi_render_ops::{Mesh, RenderError};

#[test]
fn an_index_out_of_range_is_refused_by_name() {
    let error = Mesh::new(vec![[0, 1, 2], [0, 3, 1]], 3).unwrap_err();
    assert_eq!(error, RenderError::FaceIndex { face: 1, index: 3, vertex_count: 3 });
    assert_eq!(error.to_string(), "a face needs vertex indices below 3, got 3 in face 1");
}

#[test]
fn counts_beyond_31_bits_are_refused() {
    let error = Mesh::new(vec![], 1 << 31).unwrap_err();
    assert_eq!(
        error.to_string(),
        "a mesh needs fewer than 2^31 faces and vertices, got 2147483648"
    );
    assert!(Mesh::new(vec![], (1 << 31) - 1).is_ok());
}

#[test]
fn duplicated_vertices_make_both_sides_of_a_seam_a_boundary() {
    // Vertices 3 and 4 stand where 1 and 2 do.
    let mesh = Mesh::new(vec![[0, 1, 2], [4, 3, 5]], 6).unwrap();
    assert_eq!(mesh.adjacency().across(0, 0), None);
    assert_eq!(mesh.adjacency().boundary_edges(), 6);
}

#[test]
fn two_faces_see_each_other_across_their_edge() {
    let mesh = Mesh::new(vec![[0, 1, 2], [2, 1, 3]], 4).unwrap();
    let adjacency = mesh.adjacency();
    assert_eq!(adjacency.across(0, 0), Some(3));
    assert_eq!(adjacency.across(1, 2), Some(0));
    assert_eq!(adjacency.across(0, 1), None);
    assert_eq!(adjacency.boundary_edges(), 4);
}

#[test]
fn an_edge_of_three_faces_joins_none_of_them() {
    let mesh = Mesh::new(vec![[0, 1, 2], [0, 1, 3], [0, 1, 4]], 5).unwrap();
    let adjacency = mesh.adjacency();
    assert!((0..3).all(|face| adjacency.across(face, 2).is_none()));
    assert_eq!(adjacency.crowded_edges(), 1);
    assert_eq!(adjacency.boundary_edges(), 6);
}

#[test]
fn a_face_that_repeats_a_vertex_has_no_neighbours() {
    let mesh = Mesh::new(vec![[0, 1, 2], [1, 1, 2]], 3).unwrap();
    assert_eq!(mesh.adjacency().across(0, 0), None);
    assert_eq!(mesh.adjacency().boundary_edges(), 3);
}

#[test]
fn adjacency_does_not_depend_on_the_order_of_faces() {
    let cube = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]];
    let mut reversed = cube;
    reversed.reverse();
    let (forth, back) =
        (Mesh::new(cube.to_vec(), 8).unwrap(), Mesh::new(reversed.to_vec(), 8).unwrap());
    for face in 0..6 {
        for corner in 0..3 {
            assert_eq!(
                forth.adjacency().across(face, corner),
                back.adjacency().across(5 - face, corner)
            );
        }
    }
}

#[test]
fn an_edge_is_a_seam_where_either_of_its_faces_says_so() {
    let mesh = Mesh::new(vec![[0, 1, 2], [2, 1, 3]], 4).unwrap();
    for of in 0..2 {
        // Each face faces the edge they share from a corner of its own.
        let corner = [0, 2][of];
        let seams = mesh.with_seams(|face, k| (face, k) == (of, corner));
        let all = (0..2).flat_map(|face| (0..3).map(move |k| (face, k)));
        let found: Vec<_> = all.filter(|&(face, k)| seams.is_seam(face, k)).collect();
        assert_eq!(found, [(0, 0), (1, 2)], "{of}");
    }
}
