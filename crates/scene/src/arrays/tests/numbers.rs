//! Numbers that are read are exact.

use bokashi_core::Tensor;
use glam::{DMat3, DMat4, DQuat, DVec2, DVec3, DVec4, Mat3, Mat4, Quat, Vec2, Vec3, Vec3A, Vec4};

use super::*;

/// A type of whole numbers, its least and its largest.
const WHOLE: [(NumberType, i128, i128); 9] = [
    (NumberType::Bool, 0, 1),
    (NumberType::U8, 0, u8::MAX as i128),
    (NumberType::U16, 0, u16::MAX as i128),
    (NumberType::U32, 0, u32::MAX as i128),
    (NumberType::U64, 0, u64::MAX as i128),
    (NumberType::I8, i8::MIN as i128, i8::MAX as i128),
    (NumberType::I16, i16::MIN as i128, i16::MAX as i128),
    (NumberType::I32, i32::MIN as i128, i32::MAX as i128),
    (NumberType::I64, i64::MIN as i128, i64::MAX as i128),
];

/// Whether a whole number has so few digits that a float of `digits` bits has them all.
fn is_exact(number: i128, digits: u32) -> bool {
    let size = number.unsigned_abs();
    size == 0 || u128::BITS - size.leading_zeros() - size.trailing_zeros() <= digits
}

fn array(kind: NumberType, number: i128) -> RawArray {
    let bytes = number.to_le_bytes()[..kind.bytes()].to_vec();
    RawArray::new(kind, [1, 1], bytes).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn whole_numbers_are_read_where_a_float_has_them(
        (kind, least, largest) in proptest::sample::select(WHOLE.to_vec()),
        shift in 0_u32..64,
        near in -3_i128..=3,
        bits: u64,
    ) {
        // Near powers of two, where the digits end, and anywhere.
        for number in [(1 << shift) + near, -(1 << shift) + near, bits.into(), i128::from(bits as i64)] {
            let number = number.clamp(least, largest);
            let array = array(kind, number);
            let found = array.tensor::<f32>().map(|tensor| tensor.item() as i128);
            prop_assert_eq!(found.ok(), is_exact(number, 24).then_some(number));
            let found = array.tensor::<f64>().map(|tensor| tensor.item() as i128);
            prop_assert_eq!(found.ok(), is_exact(number, 53).then_some(number));
            let index = array.indices::<1>().ok();
            prop_assert_eq!(index, u32::try_from(number).ok().map(|index| vec![[index]]));
        }
    }

    #[test]
    fn floats_are_read_with_the_same_value(bits in vec(bytes(), 8)) {
        let four = f32::from_le_bytes(bits[..4].try_into().unwrap());
        let array = RawArray::new(NumberType::F32, [], bits[..4].to_vec()).unwrap();
        prop_assert_eq!(array.tensor::<f32>().unwrap().item().to_bits(), four.to_bits());
        let wide = array.tensor::<f64>().unwrap().item();
        prop_assert!(wide == f64::from(four) || wide.is_nan() && four.is_nan());
        prop_assert_eq!(wide.is_sign_negative(), four.is_sign_negative());
        let eight = RawArray::new(NumberType::F64, [], bits.clone()).unwrap();
        prop_assert_eq!(eight.tensor::<f64>().unwrap().item().to_le_bytes().to_vec(), bits.clone());
        prop_assert!(eight.tensor::<f32>().is_err());
        // The upper half of an f32.
        let brain = RawArray::new(NumberType::Bf16, [], bits[..2].to_vec()).unwrap();
        let expected = f32::from_bits(u32::from(u16::from_le_bytes([bits[0], bits[1]])) << 16);
        let found = brain.tensor::<f32>().unwrap().item();
        prop_assert!(found == expected || found.is_nan() && expected.is_nan());
        prop_assert_eq!(found.is_sign_negative(), expected.is_sign_negative());
        let half = RawArray::new(NumberType::F16, [], bits[..2].to_vec()).unwrap();
        let (found, expected) = (half.tensor::<f64>().unwrap().item(), half_of([bits[0], bits[1]]));
        prop_assert!(found == expected || found.is_nan() && expected.is_nan());
        prop_assert_eq!(found.is_sign_negative(), expected.is_sign_negative());
    }

    #[test]
    fn tensors_keep_every_bit(shape in shapes(), seed in vec(any::<u64>(), 1..8)) {
        let numbers = |k: usize| seed[k % seed.len()].wrapping_mul(2 * k as u64 + 1);
        let wide = Tensor::from_flat_fn(shape.as_slice(), |k| f64::from_bits(numbers(k)));
        let found = RawArray::from(&wide).tensor::<f64>().unwrap();
        prop_assert_eq!(found.shape(), wide.shape());
        let bits = |tensor: &Tensor<f64>| tensor.data().iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        prop_assert_eq!(bits(&found), bits(&wide));
        let narrow = Tensor::from_flat_fn(shape.as_slice(), |k| f32::from_bits(numbers(k) as u32));
        let found = RawArray::from(&narrow).tensor::<f32>().unwrap();
        let bits = |tensor: &Tensor<f32>| tensor.data().iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        prop_assert_eq!(bits(&found), bits(&narrow));
    }
}

/// A number of binary16, by its definition in IEEE 754.
fn half_of(bytes: [u8; 2]) -> f64 {
    let bits = u16::from_le_bytes(bytes);
    let (exponent, digits) = (i32::from(bits >> 10 & 0x1f), f64::from(bits & 0x3ff) / 1024.0);
    let size = match exponent {
        0 => digits * 2.0_f64.powi(-14),
        31 if digits == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1.0 + digits) * 2.0_f64.powi(exponent - 15),
    };
    if bits >> 15 == 1 { -size } else { size }
}

#[test]
fn a_number_that_is_refused_is_named_with_its_place() {
    let numbers: Vec<u8> =
        [0_i32, 1, 2, 3, 4, 16_777_217].iter().flat_map(|x| x.to_le_bytes()).collect();
    let array = RawArray::new(NumberType::I32, [3, 2], numbers).unwrap();
    let message = array.tensor::<f32>().unwrap_err().to_string();
    let rule = "an array: i32 are read as f32 without rounding";
    assert_eq!(message, format!("{rule}, and the entry at [2, 1] is 16777217"));
    assert_eq!(array.tensor::<f64>().unwrap().data()[5], 16_777_217.0);

    let array = RawArray::new(NumberType::F64, [1], vec![0; 8]).unwrap();
    let message = array.tensor::<f32>().unwrap_err().to_string();
    let rule = "an array: numbers are read as f32 without rounding";
    assert_eq!(message, format!("{rule}, and these are f64: read f64, and `cast` rounds"));

    let array = RawArray::new(NumberType::Bool, [3], vec![0, 1, 2]).unwrap();
    let message = array.tensor::<f32>().unwrap_err().to_string();
    assert_eq!(
        message,
        "an array: bool are read as f32 without rounding, and the entry at [2] is 2"
    );
}

#[test]
fn indices_are_whole_numbers_in_rows() {
    let whole = |numbers: &[i64], shape: [usize; 2]| {
        let bytes = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        RawArray::new(NumberType::I64, shape, bytes).unwrap()
    };
    assert_eq!(whole(&[0, 1, 2, 2, 1, 3], [2, 3]).indices::<3>().unwrap(), [[0, 1, 2], [2, 1, 3]]);
    assert_eq!(whole(&[], [0, 3]).indices::<3>().unwrap(), Vec::<[u32; 3]>::new());
    let message = |array: RawArray| array.indices::<3>().unwrap_err().to_string();
    assert_eq!(
        message(whole(&[0, 1, -2], [1, 3])),
        "an array: indices are from 0 to 4294967295, and the entry at [0, 2] is -2"
    );
    assert_eq!(
        message(whole(&[0, 1], [1, 2])),
        "an array: rows of indices have shape [n, 3], and this has shape [1, 2]"
    );
    assert_eq!(
        message(RawArray::from(Tensor::<f32>::zeros([1, 3]))),
        "an array: indices are whole numbers, and this has f32"
    );
}

#[test]
fn an_array_has_the_bytes_that_its_shape_needs() {
    let message = |shape: &[usize], bytes: usize| {
        RawArray::new(NumberType::F32, shape, vec![0; bytes]).unwrap_err().to_string()
    };
    let rule = "an array: an array of shape [2, 3] has 24 bytes of f32";
    assert_eq!(message(&[2, 3], 23), format!("{rule}, and there are 23 bytes"));
    assert!(message(&[1 << 62, 4], 0).contains("more bytes of f32 than fit an index"));
    assert!(message(&[1; 65], 4).ends_with("an array has at most 64 axes, and this has 65"));
    assert!(RawArray::new(NumberType::F32, &[1 << 62, 4, 0][..], Vec::new()).is_ok());
}

#[test]
fn names_are_said_where_one_is_not_there() {
    let mut arrays = ArrayFile::new();
    let message = |arrays: &ArrayFile| arrays.get("z").unwrap_err().to_string();
    assert_eq!(message(&arrays), "arrays in memory: the arrays are none, and not \"z\"");
    for name in ["b", "a"] {
        arrays.insert(name, Tensor::scalar(1.0_f32));
    }
    assert_eq!(message(&arrays), "arrays in memory: the arrays are \"b\", \"a\", and not \"z\"");
    // What has a name already is replaced where it stands.
    arrays.insert("b", Tensor::scalar(2.0_f64));
    assert_eq!(arrays.names().collect::<Vec<_>>(), ["b", "a"]);
    assert_eq!(arrays.tensor::<f64>("b").unwrap().item(), 2.0);
    assert!(arrays.tensor::<f32>("b").is_err());
    (0..8).for_each(|k| arrays.insert(k.to_string(), Tensor::scalar(0.0_f32)));
    assert!(message(&arrays).ends_with("\"5\", 2 more, and not \"z\""), "{}", message(&arrays));
}

fn come_back<R: Row + PartialEq + std::fmt::Debug>(
    rows: &[R],
    shape: &[usize],
    flat: &[R::Number],
) {
    let tensor = tensor_of_rows(rows);
    assert_eq!((&**tensor.shape(), tensor.data()), (shape, flat));
    assert_eq!(rows_of::<R>(&tensor).unwrap(), rows);
    let empty = tensor_of_rows::<R>(&[]);
    assert_eq!((empty.shape()[0], &empty.shape()[1..]), (0, R::SHAPE));
    assert_eq!(rows_of::<R>(&empty).unwrap(), []);
}

#[test]
fn vectors_and_matrices_of_glam_are_rows() {
    let flat: [f32; 16] = std::array::from_fn(|k| k as f32);
    let wide = flat.map(f64::from);
    come_back(&[Vec2::new(0.0, 1.0), Vec2::new(2.0, 3.0)], &[2, 2], &flat[..4]);
    come_back(&[Vec3::new(0.0, 1.0, 2.0), Vec3::new(3.0, 4.0, 5.0)], &[2, 3], &flat[..6]);
    come_back(&[Vec3A::new(0.0, 1.0, 2.0)], &[1, 3], &flat[..3]);
    come_back(&[Vec4::new(0.0, 1.0, 2.0, 3.0)], &[1, 4], &flat[..4]);
    come_back(&[Quat::from_xyzw(0.0, 1.0, 2.0, 3.0)], &[1, 4], &flat[..4]);
    come_back(&[DVec2::new(0.0, 1.0)], &[1, 2], &wide[..2]);
    come_back(&[DVec3::new(0.0, 1.0, 2.0)], &[1, 3], &wide[..3]);
    come_back(&[DVec4::new(0.0, 1.0, 2.0, 3.0)], &[1, 4], &wide[..4]);
    come_back(&[DQuat::from_xyzw(0.0, 1.0, 2.0, 3.0)], &[1, 4], &wide[..4]);
    // Entry (i, j) of a matrix, which glam has by columns, is `[i, j]`.
    come_back(
        &[Mat3::from_cols_slice(&[0., 3., 6., 1., 4., 7., 2., 5., 8.])],
        &[1, 3, 3],
        &flat[..9],
    );
    come_back(
        &[DMat3::from_cols_slice(&[0., 3., 6., 1., 4., 7., 2., 5., 8.])],
        &[1, 3, 3],
        &wide[..9],
    );
    let columns =
        [0, 1, 2, 3].map(|column| Vec4::from([0, 1, 2, 3].map(|row| (4 * row + column) as f32)));
    let [x, y, z, w] = columns;
    come_back(&[Mat4::from_cols(x, y, z, w)], &[1, 4, 4], &flat);
    come_back(&[Mat4::from_cols(x, y, z, w).as_dmat4()], &[1, 4, 4], &wide);
    // The engine's way for a single camera.
    let matrix = DMat4::from_cols_array(&wide);
    let one = bokashi_render_ops::camera::to_tensor::<f64>(&matrix);
    assert_eq!(tensor_of_rows(&[matrix]).data(), one.data());
}

#[test]
fn rows_have_their_shape() {
    let message = |error: crate::SceneError| error.to_string();
    let matrix = Tensor::<f32>::zeros([2, 4]);
    let expected = "rows_of needs shape [n, 3], got shape [2, 4]";
    assert_eq!(message(rows_of::<Vec3>(&matrix).unwrap_err()), expected);
    let expected = "rows_of needs shape [n, 4, 4], got shape [2, 4]";
    assert_eq!(message(rows_of::<Mat4>(&matrix).unwrap_err()), expected);
    assert!(rows_of::<Vec3>(&Tensor::zeros([3])).is_err());
    assert!(rows_of::<Vec3>(&Tensor::zeros([])).is_err());
}
