//! The folders of a worker in; a process that the kernel keeps in them out, where the kernel can.

use crate::roots::Roots;
use std::path::Path;

/// Files outside that names of machines and the size of this one are read from.
#[cfg(target_os = "linux")]
const SYSTEM: [&str; 17] = [
    "/etc/resolv.conf",
    "/etc/hosts",
    "/etc/host.conf",
    "/etc/nsswitch.conf",
    "/etc/gai.conf",
    "/etc/localtime",
    "/etc/ld.so.cache",
    "/usr/lib",
    "/lib",
    "/lib64",
    "/proc/self",
    "/proc/meminfo",
    "/proc/cpuinfo",
    "/proc/stat",
    "/sys/fs/cgroup",
    "/sys/devices/system/cpu",
    "/dev/urandom",
];

/// Lets this process, and every thread it starts from now on, reach the folders it was given, its
/// scratch folder and the few files of the system that it needs. Why not, where the kernel cannot.
#[cfg(target_os = "linux")]
pub fn enter(roots: &Roots, scratch: &Path) -> Option<String> {
    use landlock::RulesetStatus;
    let why = match restricted(roots, scratch) {
        Ok(RulesetStatus::FullyEnforced | RulesetStatus::PartiallyEnforced) => return None,
        Ok(RulesetStatus::NotEnforced) => "this kernel has no Landlock".to_string(),
        Err(e) => e.to_string(),
    };
    Some(why)
}

#[cfg(target_os = "linux")]
fn restricted(
    roots: &Roots,
    scratch: &Path,
) -> std::result::Result<landlock::RulesetStatus, landlock::RulesetError> {
    use landlock::{
        ABI, Access, AccessFs, Ruleset, RulesetAttr, RulesetCreatedAttr, path_beneath_rules,
    };
    let abi = ABI::V3;
    let (all, read) = (AccessFs::from_all(abi), AccessFs::from_read(abi));
    let there = SYSTEM.iter().map(Path::new).filter(|path| path.exists());
    let status = Ruleset::default()
        .handle_access(all)?
        .create()?
        .add_rules(path_beneath_rules(&roots.data, read))?
        .add_rules(path_beneath_rules([roots.out.as_path(), scratch], all))?
        .add_rules(path_beneath_rules(there, read))?
        .add_rules(path_beneath_rules(["/dev/null"], all))?
        .restrict_self()?;
    Ok(status.ruleset)
}

/// The same where there is no Linux.
#[cfg(not(target_os = "linux"))]
pub fn enter(_: &Roots, _: &Path) -> Option<String> {
    Some("only Linux has Landlock".into())
}
