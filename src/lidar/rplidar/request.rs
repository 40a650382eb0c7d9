//! Requests to the sensor.

/// Stops a scan; not answered.
pub(super) const STOP: u8 = 0x25;
/// Reboots the sensor; answered with a banner in text.
pub(super) const RESET: u8 = 0x40;
/// Begins a scan of standard nodes.
pub(super) const SCAN: u8 = 0x20;
pub(super) const GET_INFO: u8 = 0x50;
pub(super) const GET_HEALTH: u8 = 0x52;
pub(super) const GET_SAMPLE_RATE: u8 = 0x59;
/// Begins a scan in the mode that is given.
pub(super) const EXPRESS_SCAN: u8 = 0x82;
pub(super) const GET_CONF: u8 = 0x84;
/// Head speed in turns/min, for the S series; not answered.
pub(super) const MOTOR_SPEED: u8 = 0xA8;
/// Motor duty, 0 to 1023, for the A series through its adapter; not answered.
pub(super) const MOTOR_PWM: u8 = 0xF0;
pub(super) const GET_BOARD_FLAG: u8 = 0xFF;

/// Items of `GET_CONF`.
pub(super) const CONF_MODE_COUNT: u32 = 0x70;
pub(super) const CONF_MODE_PERIOD: u32 = 0x71;
pub(super) const CONF_MODE_MAX_DISTANCE: u32 = 0x74;
pub(super) const CONF_MODE_ANSWER: u32 = 0x75;
pub(super) const CONF_TYPICAL_MODE: u32 = 0x7C;
pub(super) const CONF_MODE_NAME: u32 = 0x7F;

/// The bytes of a request; the payload counts only if bit 7 of the command is set.
pub(super) fn request(command: u8, payload: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0xA5, command];
    if command & 0x80 != 0 {
        bytes.push(u8::try_from(payload.len()).unwrap_or(u8::MAX));
        bytes.extend_from_slice(payload);
        bytes.push(bytes.iter().fold(0, |sum, byte| sum ^ byte));
    }
    bytes
}

/// An express scan in this mode.
pub(super) fn express_scan(mode: u16) -> Vec<u8> {
    let [low, _] = mode.to_le_bytes();
    request(EXPRESS_SCAN, &[low, 0, 0, 0, 0])
}

/// Asks for an item of the configuration, of one mode or of the sensor.
pub(super) fn get_conf(item: u32, mode: Option<u16>) -> Vec<u8> {
    let mut payload = item.to_le_bytes().to_vec();
    if let Some(mode) = mode {
        payload.extend_from_slice(&mode.to_le_bytes());
    }
    request(GET_CONF, &payload)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_those_of_the_makers_examples() {
        // Slamtec's protocol manual; what the vendor's client was seen to send.
        let express = [0xA5, 0x82, 0x05, 0x00, 0x00, 0x00, 0x00, 0x00, 0x22];
        assert_eq!(express_scan(0), express);
        assert_eq!(
            request(MOTOR_PWM, &660_u16.to_le_bytes()),
            [0xA5, 0xF0, 0x02, 0x94, 0x02, 0xC1]
        );
        let flag = [0xA5, 0xFF, 0x04, 0x00, 0x00, 0x00, 0x00, 0x5E];
        assert_eq!(request(GET_BOARD_FLAG, &[0; 4]), flag);
        assert_eq!(request(SCAN, &[]), [0xA5, 0x20]);
    }
}
