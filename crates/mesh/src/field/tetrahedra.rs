//! The faces inside the tetrahedra of a cell.
//!
//! A cube is split into six tetrahedra, one for each order of the axes (Kuhn 1960). The corners of each are corner 0, a
//! step along one axis, a further step along a second one, and corner 7. Two cubes split a common side along the same
//! diagonal, so faces fit across cells.
//!
//! In a tetrahedron the surface is one triangle where one corner is apart from the others, and two triangles where two
//! are. Each edge of a triangle lies on a side of the tetrahedron, and the next tetrahedron has the same edge. So
//! surfaces are manifold, and closed but at the grid's border.

use super::signs::{Signs, bits};

/// The corners of the tetrahedra: bit 4 of a corner is a step along x, bit 2 along y, bit 1 along z. The last three
/// are mirrored: their volume has the other sign.
const TETRAHEDRA: [[usize; 4]; 6] =
    [[0, 4, 6, 7], [0, 2, 3, 7], [0, 1, 5, 7], [0, 4, 5, 7], [0, 1, 3, 7], [0, 2, 6, 7]];

/// The corners of each edge of a tetrahedron, the lower one first.
const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// The triangles by a bit for each corner inside. A triangle has its corners on three edges, and the outside in front.
const TRIANGLES: [&[[usize; 3]]; 16] = [
    &[],
    &[[0, 1, 2]],
    &[[0, 4, 3]],
    &[[1, 2, 4], [1, 4, 3]],
    &[[1, 3, 5]],
    &[[2, 0, 3], [2, 3, 5]],
    &[[0, 4, 5], [0, 5, 1]],
    &[[2, 4, 5]],
    &[[2, 5, 4]],
    &[[0, 1, 5], [0, 5, 4]],
    &[[2, 5, 3], [2, 3, 0]],
    &[[1, 5, 3]],
    &[[1, 3, 4], [1, 4, 2]],
    &[[0, 3, 4]],
    &[[0, 2, 1]],
    &[],
];

/// The faces in the cells whose lower corners lie in the layers `layers` along x.
pub(super) fn faces(signs: &Signs, layers: std::ops::Range<usize>) -> Vec<[u32; 3]> {
    let [nx, ny, _] = signs.shape;
    let mut faces = Vec::new();
    for i in layers.start..layers.end.min(nx - 1) {
        for j in 0..ny - 1 {
            let row = i * ny + j;
            let rows = [0, 1, ny, ny + 1].map(|step| row + step);
            for word in 0..signs.words {
                let corner = |corner: usize| signs.word(rows[corner >> 1], word, corner & 1 == 1);
                let corners = [0, 1, 2, 3, 4, 5, 6, 7].map(corner);
                let [all, some] = [corners.iter().fold(u64::MAX, |all, corner| all & corner), {
                    corners.iter().fold(0, |some, corner| some | corner)
                }];
                // A cell has faces where some corners are inside and not all: 64 cells at once.
                for bit in bits(some & !all & signs.valid(word, true)) {
                    let inside = corners.map(|corner| (corner >> bit & 1) as usize);
                    add_cell(signs, &rows, word * super::signs::POINTS + bit, inside, &mut faces);
                }
            }
        }
    }
    faces
}

/// Adds the faces of the cell above point k of the first of four rows.
fn add_cell(
    signs: &Signs,
    rows: &[usize; 4],
    k: usize,
    inside: [usize; 8],
    faces: &mut Vec<[u32; 3]>,
) {
    for (number, corners) in TETRAHEDRA.iter().enumerate() {
        let case: usize = (0..4).map(|corner| inside[corners[corner]] << corner).sum();
        let triangles = TRIANGLES[case];
        for triangle in triangles {
            let vertex = |edge: usize| {
                let [lower, upper] = EDGES[edge].map(|corner| corners[corner]);
                signs.vertex(rows[lower >> 1], k + (lower & 1), upper ^ lower)
            };
            let [a, b, c] = triangle.map(vertex);
            faces.push(if number < 3 { [a, b, c] } else { [a, c, b] });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner(number: usize) -> [i32; 3] {
        [2, 1, 0].map(|bit| (number >> bit & 1) as i32)
    }

    fn minus(a: [i32; 3], b: [i32; 3]) -> [i32; 3] {
        [0, 1, 2].map(|axis| a[axis] - b[axis])
    }

    fn determinant([a, b, c]: [[i32; 3]; 3]) -> i32 {
        let minor = |i: usize, j: usize| b[i] * c[j] - b[j] * c[i];
        a[0] * minor(1, 2) - a[1] * minor(0, 2) + a[2] * minor(0, 1)
    }

    #[test]
    fn tetrahedra_fill_the_cube_and_the_last_three_are_mirrored() {
        for (number, corners) in TETRAHEDRA.into_iter().enumerate() {
            let [o, a, b, c] = corners.map(corner);
            let volume = determinant([minus(a, o), minus(b, o), minus(c, o)]);
            assert_eq!(volume, if number < 3 { 1 } else { -1 }, "{corners:?}");
        }
    }

    /// With vertices in the middle of edges, each inner corner lies behind each triangle, and each outer one before
    /// it.
    #[test]
    fn triangles_turn_their_front_to_the_outside() {
        for (case, triangles) in TRIANGLES.into_iter().enumerate() {
            let corners = TETRAHEDRA[0].map(corner);
            for triangle in triangles {
                let middle = |edge: usize| {
                    let [a, b] = EDGES[edge].map(|end| corners[end]);
                    [0, 1, 2].map(|axis| a[axis] + b[axis])
                };
                let [p, q, r] = triangle.map(middle);
                for (k, corner) in corners.into_iter().enumerate() {
                    let to = minus(corner.map(|x| 2 * x), p);
                    let side = determinant([minus(q, p), minus(r, p), to]);
                    assert!(if case >> k & 1 == 1 { side < 0 } else { side > 0 }, "{case} {k}");
                }
            }
        }
    }
}
