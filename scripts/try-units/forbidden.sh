#!/usr/bin/env bash
# Tries what a service may do, and what none may. steps.sh runs it under the unit of a service, in place of the service. The exit code is 1 if the unit
# forbids too much or too little.
#
#   forbidden.sh zk0-NAME
failed=0

may() { "$@" || { echo "it may not: $*"; failed=1; }; }
may_not() { ! "$@" >/dev/null 2>&1 || { echo "it may: $*"; failed=1; }; }

may touch "/var/lib/$1/probe" /tmp/probe
may rm "/var/lib/$1/probe"
may grep --quiet . "/etc/zk0/${1#zk0-}.toml"
for other in zk0-aggregator zk0-node zk0-prover zk0-witness; do
    [ "$other" = "$1" ] || may_not ls "/var/lib/$other"
done
# Everybody else may do these.
may_not touch /srv/everybody/probe
may_not ls /home/everybody
may_not ls /tmp/everybody
may_not ls -d /proc/1
may_not unshare --user true
may_not setarch --addr-no-randomize true
may_not chmod u+s /tmp/probe
may_not ip link
may grep --quiet 'NoNewPrivs:.*1' /proc/self/status
may grep --quiet 'CapBnd:.*0000000000000000' /proc/self/status
exit $failed
