//! URIs of buffers and images: data in the URI, or the relative path of a file.

use std::borrow::Cow;

use base64::Engine;
use base64::engine::DecodePaddingMode;
use base64::engine::general_purpose::{GeneralPurpose, GeneralPurposeConfig};

use crate::mesh::notes::name;

/// Base64 as RFC 4648 has it, with or without what fills the last group.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &base64::alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// What a URI leads to.
#[derive(Debug, PartialEq)]
pub(super) enum Target {
    /// Bytes in the URI itself.
    Data(Vec<u8>),
    /// The relative path of a file.
    File(String),
}

/// What `uri` leads to, or why it leads nowhere.
pub(super) fn target(uri: &str) -> Result<Target, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let Some((kind, data)) = data.split_once(',') else {
            return Err("a data URI has a comma before its data, and this has none".to_owned());
        };
        return match kind.ends_with(";base64") {
            true => match BASE64.decode(&*unescaped(data)?) {
                Ok(bytes) => Ok(Target::Data(bytes)),
                Err(error) => {
                    Err(format!("the data of a URI are base64, and these are not: {error}"))
                }
            },
            false => Ok(Target::Data(unescaped(data)?.into_owned())),
        };
    }
    let scheme = uri.split_once(':').map_or("", |(scheme, _)| scheme);
    let is_scheme = |byte: u8| byte.is_ascii_alphanumeric() || b"+-.".contains(&byte);
    // One letter is a drive.
    if scheme.len() > 1 && scheme.bytes().all(is_scheme) {
        return Err(format!(
            "a URI has data or a relative path, and this has the scheme {:?}",
            name(scheme)
        ));
    }
    let path = String::from_utf8(unescaped(uri)?.into_owned());
    path.map(Target::File).map_err(|error| format!("a path is UTF-8: {error}"))
}

/// Bytes with `%20` and its like as what they stand for.
pub(crate) fn unescaped(text: &str) -> Result<Cow<'_, [u8]>, String> {
    if !text.contains('%') {
        return Ok(Cow::Borrowed(text.as_bytes()));
    }
    let mut bytes = Vec::with_capacity(text.len());
    let mut left = text.as_bytes();
    while let Some((&byte, rest)) = left.split_first() {
        left = rest;
        if byte != b'%' {
            bytes.push(byte);
            continue;
        }
        let digit = |k: usize| rest.get(k).and_then(|&digit| char::from(digit).to_digit(16));
        let (Some(high), Some(low)) = (digit(0), digit(1)) else {
            return Err(
                "a % in a URI has two digits of base 16 after it, and one has not".to_owned()
            );
        };
        bytes.push((16 * high + low) as u8);
        left = &rest[2..];
    }
    Ok(Cow::Owned(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uris_lead_to_data_or_files() {
        let data = |bytes: &[u8]| Ok(Target::Data(bytes.to_vec()));
        let file = |path: &str| Ok(Target::File(path.to_owned()));
        let cases = [
            ("data:application/octet-stream;base64,AAEC/w==", data(&[0, 1, 2, 255])),
            ("data:application/octet-stream;base64,AAEC/w", data(&[0, 1, 2, 255])),
            ("data:;base64,", data(&[])),
            ("data:text/plain,a%20b", data(b"a b")),
            ("a.bin", file("a.bin")),
            ("a%20b/%c3%a4.bin", file("a b/ä.bin")),
            ("C:/a.bin", file("C:/a.bin")),
        ];
        for (uri, expected) in cases {
            assert_eq!(target(uri), expected, "{uri}");
        }
        let broken = ["data:", "data:;base64,!", "https://a/b", "file:///a", "a%2", "a%zz", "%ff"];
        for uri in broken {
            assert!(target(uri).is_err(), "{uri}");
        }
    }
}
