# Starts a daemon of its own in $work (sourced; wants $bin; the arguments are flags of the daemon): its address is in $work/data/address, an input in $work/part.hexex.
work=$(mktemp -d)
daemon=
finish() {
    [ -z "$daemon" ] || kill "$daemon" 2>/dev/null || true
    [ -z "$daemon" ] || wait "$daemon" 2>/dev/null || true
    rm -rf "$work"
}
trap finish EXIT
cd "$work"
: >settings
"$bin/blockwright" sample cuboid --size 2 -o "$work/part.hexex" >/dev/null 2>&1
"$bin/blockwrightd" --data "$work/data" --listen 127.0.0.1:0 "$@" 2>"$work/log" &
daemon=$!
i=0
while [ ! -s "$work/data/address" ]; do
    i=$((i + 1))
    [ $i -lt 200 ] || { cat "$work/log"; exit 1; }
    sleep 0.1
done
