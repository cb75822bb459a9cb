#!/usr/bin/env bash
# Tries what a service may do, and what none may. steps.sh runs it under the unit of a service, in place of the service. The exit code is 1 if the unit
# forbids too much or too little.
#
#   forbidden.sh zk0-NAME
failed=0

may() { "$@" || { echo "it may not: $*"; failed=1; }; }
may_not() { ! "$@" 2>/dev/null || { echo "it may: $*"; failed=1; }; }

may touch "/var/lib/$1/probe" /tmp/probe
may rm "/var/lib/$1/probe"
may cat "/etc/zk0/${1#zk0-}.toml" >/dev/null
for folder in /etc/zk0 /usr/local/bin /var/lib /var /root /run; do
    may_not touch "$folder/probe"
done
for other in zk0-aggregator zk0-node zk0-prover; do
    [ "$other" = "$1" ] || may_not ls "/var/lib/$other"
done
may_not ls /root
may_not cat /root/zk0/README.md
may_not ls /proc/1/cwd/
may_not ls /dev/kmsg
may_not unshare --user true
may_not mount -t tmpfs tmpfs /tmp
may_not chmod u+s /tmp/probe
may_not sudo --non-interactive true
exit $failed
