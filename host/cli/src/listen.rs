//! Addresses that the program listens on.

use camrig_base::{Error, Result};
use camrig_rig as rig;

/// Refuses an address that other machines can reach, unless that is allowed; then prints what they
/// can do.
pub fn remote(address: &str, allowed: bool, opens: &str) -> Result<()> {
    if !rig::serve::is_open_to_others(address) {
        return Ok(());
    }
    let what = format!("other machines on the network can {opens}");
    if !allowed {
        return Err(Error::input(format!("{address} is not on the loopback interface: {what}"))
            .help("listen on 127.0.0.1:PORT, or allow it with --allow-remote"));
    }
    eprintln!("note: {address}: {what}");
    Ok(())
}
