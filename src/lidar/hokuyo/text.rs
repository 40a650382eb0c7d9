//! Sums and numbers of SCIP.

/// The sum character of a line.
#[must_use]
pub fn sum_of(line: &[u8]) -> u8 {
    (line.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte)) & 0x3F) + 0x30
}

/// A number of up to five characters, six bits each; `None` for a character outside `0` to `o`.
#[must_use]
pub fn number(text: &[u8]) -> Option<u32> {
    text.iter().try_fold(0, |number: u32, byte| {
        let six = byte.checked_sub(0x30).filter(|six| *six < 64)?;
        Some(number << 6 | u32::from(six))
    })
}

/// What a line says, if its last character is the sum of the others.
pub(super) fn checked(line: &[u8]) -> Option<&[u8]> {
    let (sum, text) = line.split_last()?;
    (sum_of(text) == *sum).then_some(text)
}

/// Name and value of a line such as `MODL:URG-04LX;sum`, if its sum is right.
pub(super) fn key_and_value(line: &[u8]) -> Option<(String, String)> {
    // The sum itself can be a semicolon, so the line is taken apart from its end.
    let (sum, rest) = line.split_last()?;
    let text = rest.strip_suffix(b";")?;
    if sum_of(text) != *sum {
        return None;
    }
    let text = std::str::from_utf8(text).ok()?;
    text.split_once(':').map(|(key, value)| (key.to_owned(), value.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_those_of_the_specification() {
        // Examples of the SCIP 2.0 specification, sections on 2-, 3- and 4-character encoding.
        assert_eq!(number(b"CB"), Some(1234));
        assert_eq!(number(b"1Dh"), Some(5432));
        assert_eq!(number(b"m2@0"), Some(16_000_000));
        assert_eq!(number(b"p"), None);
        assert_eq!(number(b"/"), None);
    }

    #[test]
    fn sums_of_the_usual_states() {
        for (state, sum) in [("00", 'P'), ("01", 'Q'), ("02", 'R'), ("99", 'b'), ("0E", 'e')] {
            assert_eq!(char::from(sum_of(state.as_bytes())), sum);
        }
        assert_eq!(checked(b"99b"), Some(&b"99"[..]));
        assert_eq!(checked(b"98b"), None);
    }

    #[test]
    fn a_sum_that_is_a_semicolon_is_no_separator() {
        // A real sensor's line.
        let line = b"VEND:Hokuyo Automatic Co., Ltd.;;";
        let (key, value) = key_and_value(line).unwrap();
        assert_eq!((key.as_str(), value.as_str()), ("VEND", "Hokuyo Automatic Co., Ltd."));
    }
}
