//! Frames whose bytes were worked out from the makers' documents by a script that shares nothing with
//! this program: the folder `vectors`. Drivers must read them and emulated sensors must send them, so
//! that the two cannot be wrong alike.

/// The bytes of a file of hexadecimal numbers; lines that begin with `#` say what they are.
pub(super) fn bytes(text: &str) -> Vec<u8> {
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines.flat_map(str::split_whitespace).map(|hex| u8::from_str_radix(hex, 16).unwrap()).collect()
}

/// The numbers of a file of decimal numbers.
pub(super) fn numbers(text: &str) -> Vec<f64> {
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines.map(|number| number.parse().unwrap()).collect()
}

#[test]
fn files_of_numbers_are_read() {
    assert_eq!(bytes("# what\n0A ff\n01\n"), [10, 255, 1]);
    assert_eq!(numbers("# what\n1.5\n2\n").len(), 2);
}
