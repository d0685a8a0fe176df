//! Poses as files have them: rotations to a few digits.

use glam::{DMat3, DMat4, DVec3};

/// A matrix this near to a rotation stays as it is.
const EXACT: f64 = 1e-6;
/// A matrix this near to a rotation becomes the nearest one.
const MOST: f64 = 1e-3;

/// The pose of the rows of a file's matrix, 3 or 4 of 4 numbers.
///
/// # Errors
/// The rule that is broken and what broke it.
pub(super) fn pose(rows: &[Vec<f64>]) -> Result<DMat4, String> {
    if !(3..=4).contains(&rows.len()) || rows.iter().any(|row| row.len() != 4) {
        let lengths: Vec<usize> = rows.iter().take(5).map(Vec::len).collect();
        let message = format!("{} rows of lengths {lengths:?}", rows.len());
        return Err(format!("a pose has 3 or 4 rows of 4 numbers, and this has {message}"));
    }
    if let Some(number) = rows.iter().flatten().find(|number| !number.is_finite()) {
        return Err(format!("a pose has finite numbers, and this has {number}"));
    }
    if let Some(last) = rows.get(3)
        && last.iter().zip([0.0, 0.0, 0.0, 1.0]).any(|(entry, rule)| (entry - rule).abs() > EXACT)
    {
        return Err(format!("the last row of a pose is [0, 0, 0, 1], and this is {last:?}"));
    }
    let column = |k: usize| DVec3::new(rows[0][k], rows[1][k], rows[2][k]);
    let rotation = rotation(DMat3::from_cols(column(0), column(1), column(2)))?;
    Ok(DMat4::from_cols(
        rotation.x_axis.extend(0.0),
        rotation.y_axis.extend(0.0),
        rotation.z_axis.extend(0.0),
        column(3).extend(1.0),
    ))
}

/// `matrix` itself, or the nearest rotation where it is off by rounding.
fn rotation(matrix: DMat3) -> Result<DMat3, String> {
    let products = matrix * matrix.transpose() - DMat3::IDENTITY;
    let worst = |k: usize| products.row(k).abs().max_element();
    for row in 0..3 {
        if worst(row) > MOST {
            let entries = matrix.row(row);
            let rule = "the rows of a rotation are perpendicular and have length 1, to 0.001";
            return Err(format!("{rule}, and row {} is {entries}", row + 1));
        }
    }
    if matrix.determinant() < 0.0 {
        return Err("a rotation does not mirror, and this does".to_owned());
    }
    if (0..3).all(|row| worst(row) <= EXACT) {
        return Ok(matrix);
    }
    // Newton's iteration for the polar decomposition: the error is squared in each step.
    let step = |matrix: DMat3| (matrix + matrix.inverse().transpose()) * 0.5;
    Ok((0..4).fold(matrix, |matrix, _| step(matrix)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(matrix: DMat3, translation: DVec3) -> Vec<Vec<f64>> {
        (0..3).map(|k| [matrix.row(k).to_array().as_slice(), &[translation[k]]].concat()).collect()
    }

    #[test]
    fn a_rotation_stays_and_a_rounded_one_becomes_the_nearest() {
        let exact = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, 2.0) / 3.0, 1.1);
        let translation = DVec3::new(1.0, -2.0, 3.0);
        let found = pose(&rows(exact, translation)).unwrap();
        assert_eq!(found, DMat4::from_mat3_translation(exact, translation));
        // To four digits.
        let rounded = |number: f64| (number * 1e4).round() / 1e4;
        let matrix = DMat3::from_cols_array(&exact.to_cols_array().map(rounded));
        let found = DMat3::from_mat4(pose(&rows(matrix, translation)).unwrap());
        let error = found * found.transpose() - DMat3::IDENTITY;
        assert!(error.to_cols_array().iter().all(|error| error.abs() < 1e-15), "{error}");
        assert!(found.abs_diff_eq(exact, 1e-4) && found != matrix);
        // The nearest one: what is left over is symmetric.
        let left = found.transpose() * matrix;
        assert!((left - left.transpose()).abs_diff_eq(DMat3::ZERO, 1e-15));
    }

    #[test]
    fn what_is_no_pose_is_refused_with_the_rule() {
        let one = DMat3::IDENTITY;
        let mirrored = DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0));
        let large = DMat3::from_diagonal(DVec3::new(1.0, 1.002, 1.0));
        let mut wrong = rows(one, DVec3::ZERO);
        wrong[1].pop();
        let mut perspective = rows(one, DVec3::ZERO);
        perspective.push(vec![0.0, 0.0, 1.0, 1.0]);
        for (rows, rule) in [
            (rows(mirrored, DVec3::ZERO), "does not mirror"),
            (rows(large, DVec3::ZERO), "and row 2 is [0, 1.002, 0]"),
            (rows(DMat3::ZERO, DVec3::ZERO), "perpendicular and have length 1"),
            (rows(one * f64::MAX, DVec3::ZERO), "perpendicular and have length 1"),
            (rows(one * f64::NAN, DVec3::ZERO), "finite"),
            (rows(one, DVec3::INFINITY), "finite"),
            (wrong, "3 or 4 rows of 4 numbers, and this has 3 rows of lengths [4, 3, 4]"),
            (
                perspective,
                "the last row of a pose is [0, 0, 0, 1], and this is [0.0, 0.0, 1.0, 1.0]",
            ),
            (Vec::new(), "3 or 4 rows"),
        ] {
            let message = pose(&rows).unwrap_err();
            assert!(message.contains(rule), "{message}");
        }
    }
}
