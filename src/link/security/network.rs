//! Addresses that may send datagrams.

use std::fmt;
use std::net::IpAddr;
use std::str::FromStr;

/// One address or all that share its first bits.
///
/// ```
/// use stockpilot::link::Network;
/// let hall: Network = "192.168.7.0/24".parse()?;
/// assert!(hall.contains("192.168.7.20".parse().unwrap()));
/// assert!(!hall.contains("192.168.8.20".parse().unwrap()));
/// # Ok::<(), stockpilot::link::NetworkError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Network {
    address: IpAddr,
    n_bits: u8,
}

/// Why a network was refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is not an address such as 192.168.7.2, nor a network such as 192.168.7.0/24")]
pub struct NetworkError(String);

impl Network {
    /// True if `address` is this one or in this network.
    #[must_use]
    pub fn contains(&self, address: IpAddr) -> bool {
        match (self.address, address.to_canonical()) {
            (IpAddr::V4(own), IpAddr::V4(other)) => share_bits(
                u128::from(own.to_bits()) << 96,
                u128::from(other.to_bits()) << 96,
                self.n_bits,
            ),
            (IpAddr::V6(own), IpAddr::V6(other)) => {
                share_bits(own.to_bits(), other.to_bits(), self.n_bits)
            }
            _ => false,
        }
    }
}

/// True if the first `n_bits` are equal.
const fn share_bits(a: u128, b: u128, n_bits: u8) -> bool {
    // A shift by all 128 bits is none in the language.
    n_bits == 0 || (a ^ b) >> (128 - n_bits) == 0
}

impl FromStr for Network {
    type Err = NetworkError;

    fn from_str(text: &str) -> Result<Self, NetworkError> {
        let wrong = || NetworkError(text.to_owned());
        let (address, n_bits) = match text.split_once('/') {
            Some((address, n_bits)) => (address, Some(n_bits)),
            None => (text, None),
        };
        let address: IpAddr = address.parse().map_err(|_| wrong())?;
        let most = if address.is_ipv4() { 32 } else { 128 };
        let n_bits = n_bits.map_or(Ok(most), str::parse).map_err(|_| wrong())?;
        if n_bits > most {
            return Err(wrong());
        }
        Ok(Self { address, n_bits })
    }
}

impl fmt::Display for Network {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let is_one = self.n_bits == if self.address.is_ipv4() { 32 } else { 128 };
        if is_one {
            write!(f, "{}", self.address)
        } else {
            write!(f, "{}/{}", self.address, self.n_bits)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holds_exactly_the_addresses_with_its_first_bits() {
        for (network, inside, outside) in [
            ("10.0.0.7", "10.0.0.7", "10.0.0.6"),
            ("10.0.0.7", "::ffff:10.0.0.7", "::ffff:10.0.1.7"),
            ("172.16.0.0/12", "172.31.255.255", "172.32.0.0"),
            ("192.168.7.128/25", "192.168.7.200", "192.168.7.127"),
            ("0.0.0.0/0", "203.0.113.9", "::1"),
            ("fd00::/8", "fdff::1", "fe00::1"),
            ("::1", "::1", "::2"),
        ] {
            let parsed: Network = network.parse().unwrap();
            assert_eq!(parsed.to_string(), network);
            assert!(parsed.contains(inside.parse().unwrap()), "{network} {inside}");
            assert!(!parsed.contains(outside.parse().unwrap()), "{network} {outside}");
        }
        for text in ["", "hall", "10.0.0", "10.0.0.0/33", "10.0.0.0/", "::/129", "1.2.3.4:5"] {
            assert!(text.parse::<Network>().is_err(), "{text}");
        }
    }
}
