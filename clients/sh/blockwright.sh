#!/bin/sh
# A client for blockwrightd that needs no more than a POSIX shell with its awk and sed, curl and sha256sum. See usage().
#
# It splits the daemon's JSON into members with awk, minding strings and nesting. Everything that is used for more than
# showing it (ids, states, hashes, file names) is a plain word by the API's schemas, and one that does not look so is
# refused. Free text (why a job failed, a job's name) is only ever printed, after its escapes have been resolved.
set -u

usage() {
    cat <<'END'
Usage: blockwright.sh COMMAND ...

  submit FILE [--parameters FILE] [--kind auto|tet|hex] [--complex mc|bc|serial] [--reduce none|keep-singular|full] [--until STAGE]
         [--explore none|auto|enumerate|swap|enumerate+swap|anneal|exact] [--explore-cost blocks|bits|bits-by-block|cubes|weighted]
         [--explore-weights W,W,W,W] [--explore-expand random|cheapest] [--beam N] [--seed N] [--explore-work N] [--explore-time SECONDS]
         [--quantize none|positive|nonnegative|any] [--scale S | --coarsest | --fewest-hexes | --target-hexes N] [--rounding] [--repair]
         [--route auto|quality|guaranteed] [--max-map-work N] [--subdivide N] [--max-hexes N] [--smooth on|off]
         [--hex-formats F,F,...] [--bwh-bits N] [--tmesh] [--name TEXT] [--pin] [--wait] [--out DIR]
         [--limit-memory BYTES] [--limit-scratch BYTES] [--limit-cpu SECONDS] [--limit-wall SECONDS]
         [--limit-job-cpu SECONDS] [--limit-job-wall SECONDS]
                     upload FILE (and the parameters of a Medit mesh), create a job, print its id; --wait follows it,
                     --out also fetches the results; --limit-...: most of it that each stage may take, or all of
                     them together
  watch ID           wait until job ID has ended
  fetch ID --out DIR bring its results home, each checked against its SHA-256
  finish ID          ask its search to settle for the best found; the job goes on with that
  cancel ID          ask it to stop; nothing of it is kept
  retry ID           put a job that failed or was cancelled back into the queue
  rm ID              remove a job that has ended
  pin ID             keep it, whatever its age
  unpin ID           let it go by age again
  ls                 list the jobs: id, state, name
  log ID [--follow]  show what its workers logged; --follow goes on until it has ended
  report ID          print its report.json
  capabilities       print what the daemon can do, as JSON

The daemon's address: --server URL, or the environment's BLOCKWRIGHT_SERVER, or http://127.0.0.1:8080.
Its access token, if it wants one: the environment's BLOCKWRIGHT_TOKEN, or the first line of --token-file FILE. Certificates to
trust for https: the environment's BLOCKWRIGHT_CA_FILE, or the system's.
--quiet says nothing but ids and errors.

Exit codes: 0 done, 2 usage, 3 bad input, 4 limit reached or cancelled, 5 internal.

  BLOCKWRIGHT_SERVER=http://127.0.0.1:8080
  id=$(sh blockwright.sh submit part.hexex) && sh blockwright.sh watch "$id" && sh blockwright.sh fetch "$id" --out result
END
}

note() { [ "$quiet" = yes ] || printf '%s\n' "$*" >&2; }
error() { printf 'blockwright.sh: %s\n' "$*" >&2; }
mistake() {
    error "$*"
    error "try --help"
    exit 2
}

# number OPTION VALUE: a value that goes into JSON as it is.
number() {
    case $2 in
    '' | *[!0-9.]* | *.*.* | .* | *. | 0[0-9]*) mistake "$1 wants a number, not '$2'" ;;
    esac
}

# ---- JSON, as far as it is needed ----

# One member per line: breaks the text (FILE) at commas and braces that stand outside of strings, drops the space around
# them. Strings keep their escapes.
members() {
    awk '
        { text = text $0 " " }
        END {
            n = length(text); inside = 0; line = ""
            for (i = 1; i <= n; i++) {
                c = substr(text, i, 1)
                if (inside) {
                    line = line c
                    if (c == "\\") { i++; line = line substr(text, i, 1) }
                    else if (c == "\"") inside = 0
                } else if (c == "\"") { inside = 1; line = line c }
                else if (c ~ /[{}\[\],]/) { if (line != "") print line; print c; line = "" }
                else if (c !~ /[ \t\r]/) line = line c
            }
            if (line != "") print line
        }' "$1"
}

# Value of member NAME at depth DEPTH (1: of the outermost object) in FILE, strings without their quotes; the first one.
value() {
    members "$1" | awk -v name="\"$2\":" -v want="$3" '
        /^[{\[]$/ { depth++; next }
        /^[}\]]$/ { depth--; next }
        depth == want && index($0, name) == 1 {
            text = substr($0, length(name) + 1)
            if (text ~ /^".*"$/) text = substr(text, 2, length(text) - 2)
            print text
            exit
        }'
}

# Like value(), for a member of the object FIELD that is itself a member of the outermost object.
inner() {
    members "$1" | awk -v field="\"$2\":" -v name="\"$3\":" '
        /^[{\[]$/ { depth++; if (depth == 2) within = (last == field); last = ""; next }
        /^[}\]]$/ { depth--; last = ""; next }
        { last = $0 }
        depth == 2 && within && index($0, name) == 1 {
            text = substr($0, length(name) + 1)
            if (text ~ /^".*"$/) text = substr(text, 2, length(text) - 2)
            print text
            exit
        }'
}

# Text of a JSON string for people: escapes resolved, control characters gone.
plain() { sed -e 's/\\[nrt]/ /g' -e 's/\\u00[01][0-9a-fA-F]/?/g' -e 's/\\\(["\\/]\)/\1/g' | tr -d '\000-\010\013-\037\177'; }

# A JSON string for TEXT; what is not printable is left out.
quoted() { printf '"%s"' "$(printf '%s' "$1" | tr -d '\000-\037\177' | sed 's/[\\"]/\\&/g')"; }

# ---- HTTP ----

# Has the daemon only been asked too often? Then it has done nothing, and may be asked again in $after seconds. An answer to HEAD has no problem in it.
too_often() {
    [ "$status" = 429 ] || return 1
    after=$(tr -d '\r' <"$work/answered" | sed -n 's/^[Rr]etry-[Aa]fter: *\([0-9]\{1,2\}\)$/\1/p' | tail -n 1)
    [ -n "$after" ] || return 1
    [ "$method" = HEAD ] || grep -q '"/problems/too-many-requests"' "$into"
}

# request METHOD PATH [curl options]: the body goes to $into, which is $work/body, the status to $status. Fails if there is no answer.
request() {
    method=$1
    path=$2
    shift 2
    case $method in
    HEAD) set -- --head "$@" ;;
    *) set -- -X "$method" "$@" ;;
    esac
    turns=0
    while :; do
        : >"$work/answered"
        status=$(curl -sS -K "$work/curlrc" --connect-timeout 10 --speed-limit 1 --speed-time 120 -D "$work/answered" -o "$into" \
            -w '%{http_code}' "$@" "$server$path" 2>"$work/curl")
        if [ $turns = 20 ] || ! too_often; then break; fi
        turns=$((turns + 1))
        sleep "$after"
    done
    case $status in
    [2345][0-9][0-9]) return 0 ;;
    esac
    return 1
}

# stream PATH HANDLER: calls HANDLER EVENT DATA for every server-sent event at PATH, from after $last on, which is kept up to date, until there is
# no more. $status is that of HTTP then (not three digits: there was no answer), $ended tells whether the daemon has said that this is the end;
# an answer that is no stream is in $work/body.
stream() {
    path=$1
    handler=$2
    set --
    [ -z "$last" ] || set -- -H "Last-Event-ID: $last"
    [ -p "$work/stream" ] || mkfifo "$work/stream" || exit 5
    : >"$work/head"
    : >"$work/body"
    ended=no status='' event=message data='' number=''
    curl -sS -N -K "$work/curlrc" --connect-timeout 10 --speed-limit 1 --speed-time 120 -D "$work/head" -H 'Accept: text/event-stream' \
        "$@" "$server$path" >"$work/stream" 2>"$work/curl" &
    streaming=$!
    while IFS= read -r line; do
        line=${line%"$cr"}
        [ -n "$status" ] || read_status
        if [ "$status" = 200 ]; then stream_line; else printf '%s\n' "$line" >>"$work/body"; fi
    done <"$work/stream"
    wait "$streaming"
    streaming=
    [ -n "$status" ] || read_status
}

read_status() { status=$(sed -n 's/^HTTP[^ ]* \([0-9][0-9][0-9]\).*/\1/p' "$work/head" | tail -n 1); }

# One line of a stream; an empty one ends an event, and one whose end has not come is none.
stream_line() {
    case $line in
    data:*)
        line=${line#data:}
        data=$data${line# }$newline
        ;;
    event:*)
        event=${line#event:}
        event=${event# }
        ;;
    id:*)
        number=${line#id:}
        number=${number# }
        ;;
    '')
        [ -z "$data" ] || "$handler" "$event" "${data%"$newline"}"
        [ "$event" != end ] || ended=yes
        case $number in
        '' | *[!0-9]*) ;;
        *) last=$number ;;
        esac
        event=message data='' number=''
        ;;
    esac
}

# Is it a proxy that answers, whose daemon is not there, or a daemon that stops just now?
away() {
    case $status in
    502 | 503 | 504) return 0 ;;
    esac
    return 1
}

silent() {
    away && complain "$work/body" '' ''
    error "$server does not answer: $(sed 's/^curl: //' "$work/curl" | head -n 1)"
    exit 5
}

# Exit code for a problem CODE of class CLASS answered with HTTP status: the table of core/base/status.def.
exit_of() {
    case $1 in
    usage | bad-request | bad-json | invalid-option | invalid-parameter) return 2 ;;
    esac
    case $2 in
    input) return 3 ;;
    limit) return 4 ;;
    algorithm | system) return 5 ;;
    esac
    case $3 in
    400) return 2 ;;
    413 | 429) return 4 ;;
    4??) return 3 ;;
    esac
    return 5
}

# Says what the problem in FILE means and ends. With a FIELD the problem is that member of the outermost object.
complain() {
    if [ -n "$2" ]; then
        type=$(inner "$1" "$2" type)
        detail=$(inner "$1" "$2" detail)
        class=$(inner "$1" "$2" class)
        http=$(inner "$1" "$2" status)
        [ -n "$detail" ] || detail=$(inner "$1" "$2" title)
    else
        type=$(value "$1" type 1)
        detail=$(value "$1" detail 1)
        class=$(value "$1" class 1)
        http=$status
        [ -n "$detail" ] || detail=$(value "$1" title 1)
    fi
    if [ -z "$type" ]; then
        error "$server answered with HTTP status $status, not as a Blockwright daemon does"
        exit 5
    fi
    code=${type##*/}
    error "$3$(printf '%s' "$detail" | plain) [$code]"
    elements "$1" >&2
    exit_of "$code" "$class" "$http"
    exit
}

# The first ten elements at fault, one a line: "  tet 17 at (0.25, 0.5, 1)".
elements() {
    members "$1" | awk '
        function flush() {
            if (kind != "" && shown++ < 10) print "  " kind " " id (at != "" ? " at (" at ")" : "")
            kind = id = at = ""
        }
        { word = $0 }
        word == "\"elements\":" { listed = depth + 1; next }
        /^[{\[]$/ { depth++; next }
        /^[}\]]$/ { if (listed && depth == listed + 1) flush(); if (depth == listed) listed = 0; depth--; next }
        /^,$/ { next }
        listed && index(word, "\"kind\":") == 1 { kind = word; gsub(/"kind":|"/, "", kind); next }
        listed && index(word, "\"id\":") == 1 { id = substr(word, 6); next }
        listed && depth == listed + 2 { at = at (at == "" ? "" : ", ") word }'
}

# ---- commands ----

check_id() {
    case $1 in
    '' | *[!0-9A-Za-z_-]*) mistake "'$1' is not a job id" ;;
    esac
}

# upload FILE: makes sure the daemon has it; its name there goes to $hash.
upload() {
    [ -r "$1" ] || {
        error "$1 cannot be read"
        exit 5
    }
    hash=$(sha256sum <"$1") || exit 5
    hash=${hash%% *}
    request HEAD "/v1/blobs/$hash" || silent
    if [ "$status" != 200 ]; then # an answer to HEAD has no words for what is wrong; sending it tells
        request PUT "/v1/blobs/$hash" -T "$1" -H 'Content-Type: application/octet-stream' || silent
    fi
    case $status in
    2??) ;;
    *) complain "$work/body" '' '' ;;
    esac
}

submit() {
    side=
    if [ -n "$parameters" ]; then
        upload "$parameters"
        side="\"parameters\": \"$hash\", "
    fi
    upload "$1"
    options=
    [ -z "$kind" ] || options="\"kind\": $(quoted "$kind")"
    [ -z "$complex" ] || options="${options:+$options, }\"complex\": $(quoted "$complex")"
    [ -z "$reduce" ] || options="${options:+$options, }\"reduce\": $(quoted "$reduce")"
    [ -z "$explore" ] || options="${options:+$options, }\"explore\": $(quoted "$explore")"
    [ -z "$explore_cost" ] || options="${options:+$options, }\"explore_cost\": $(quoted "$explore_cost")"
    [ -z "$explore_expand" ] || options="${options:+$options, }\"explore_expand\": $(quoted "$explore_expand")"
    options="${options:+$options${explore_numbers:+, }}$explore_numbers"
    [ -z "$until" ] || options="${options:+$options, }\"until\": $(quoted "$until")"
    [ -z "$quantize" ] || options="${options:+$options, }\"quantize\": $(quoted "$quantize")"
    [ -z "$size" ] || options="${options:+$options, }$size"
    [ -z "$route" ] || options="${options:+$options, }\"route\": $(quoted "$route")"
    [ -z "$map_work" ] || options="${options:+$options, }\"max_map_work\": $map_work"
    [ -z "$max_hexes" ] || options="${options:+$options, }\"max_hexes\": $max_hexes"
    [ -z "$subdivide" ] || options="${options:+$options, }\"subdivide\": $subdivide"
    [ -z "$smooth" ] || options="${options:+$options, }\"smooth\": $(quoted "$smooth")"
    [ -z "$formats" ] || options="${options:+$options, }\"hex_formats\": [$(quoted "$formats" | sed 's/,/", "/g')]"
    [ -z "$bits" ] || options="${options:+$options, }\"bwh_bits\": $bits"
    [ $rounding = no ] || options="${options:+$options, }\"rounding\": true"
    [ $tmesh = no ] || options="${options:+$options, }\"tmesh\": \"yes\""
    [ $repair = no ] || options="${options:+$options, }\"repair\": true"
    extra=${limits:+"\"limits\": {$limits}, "}
    [ $pin = no ] || extra="$extra\"pinned\": true, "
    printf '{"input": "%s", %s%s"name": %s, "options": {%s}}' "$hash" "$side" "$extra" "$(quoted "${name:-$(basename "$1")}")" \
        "$options" >"$work/request"
    request POST /v1/jobs -H 'Content-Type: application/json' --data-binary "@$work/request" || silent
    [ "$status" = 201 ] || complain "$work/body" '' ''
    id=$(value "$work/body" id 1)
    check_id "$id"
    printf '%s\n' "$id"
    note "job $id is at $server/v1/jobs/$id"
    if [ $wait = yes ] || [ -n "$out" ]; then watch "$id"; fi
    if [ -n "$out" ]; then fetch "$id"; fi
}

pause() { sleep 0.5 2>/dev/null || sleep 1; }

# After half a minute without an answer the daemon is not waited for any longer.
wait_for_it() {
    silence=$((silence + 1))
    [ $silence -lt 60 ] || silent
}

announce() {
    [ "$1" = "$shown" ] || note "$1"
    shown=$1
}

# An event of the job that is watched: a stage that begins, of the attempt that was seen or a later one, or that it waits again.
on_job_event() {
    case $1 in
    stage | state) ;;
    *) return ;;
    esac
    printf '%s\n' "$2" >"$work/event"
    [ "$(value "$work/event" attempt 1)" -ge "$attempt" ] 2>/dev/null || return 0
    state=$(value "$work/event" state 1)
    case $state:$(value "$work/event" change 1) in
    running:started) announce "running $(value "$work/event" stage 1)" ;;
    queued:*) announce queued ;;
    esac
}

# Follows the stream of a job's events; when that is over the job is asked. A daemon that is restarted meanwhile is waited for.
watch() {
    silence=60 # one that never answered is not
    shown=
    last=
    while :; do
        ended=no
        if request GET "/v1/jobs/$1" && ! away; then
            silence=0
            [ "$status" = 200 ] || complain "$work/body" '' ''
            state=$(value "$work/body" state 1)
            attempt=$(members "$work/body" | awk '/^"attempt":[0-9]+$/ { n = substr($0, 11) } END { print n + 0 }')
            case $state in
            queued) announce queued ;;
            running) announce "running $(value "$work/body" stage 1)" ;;
            successful)
                announce successful
                return
                ;;
            failed) complain "$work/body" failure "job $1: " ;;
            dismissed)
                error "job $1 was cancelled"
                exit 4
                ;;
            *)
                error "job $1 is in a state this program does not know: $state"
                exit 5
                ;;
            esac
            stream "/v1/jobs/$1/events" on_job_event
        else
            wait_for_it
        fi
        [ $ended = yes ] || pause
    done
}

on_log_event() { [ "$1" != log ] || printf '%s\n' "$2" | tr -d '\000-\010\013-\037\177'; }

# Prints the log of job ID until the job has ended; no line is lost or repeated when the daemon is restarted meanwhile.
follow_log() {
    silence=60
    last=
    while :; do
        stream "/v1/jobs/$1/log?follow=true" on_log_event
        case $status in
        200) silence=0 ;;
        204) return ;;
        502 | 503 | 504) wait_for_it ;;
        429) grep -q '"/problems/too-many-requests"' "$work/body" || complain "$work/body" '' '' ;;
        [345]??) complain "$work/body" '' '' ;;
        *) wait_for_it ;;
        esac
        [ $ended = no ] || return 0
        pause
    done
}

# Every entry of the manifest on standard input as a line NAME BYTES SHA256.
manifest() {
    members "$1" | awk '
        function text(line) { sub(/^"[a-z0-9_]*":/, "", line); gsub(/"/, "", line); return line }
        /^"name":/ { name = text($0) }
        /^"bytes":/ { bytes = text($0) }
        /^"sha256":/ { sum = text($0) }
        /^}$/ { if (name != "") print name, bytes, sum; name = bytes = sum = "" }'
}

fetch_one() {
    case $1 in
    '' | .* | */* | *[!0-9A-Za-z._-]*)
        error "the list of results has a name this program does not accept"
        exit 5
        ;;
    esac
    part=$out/.$1.part
    into=$part
    request GET "/v1/jobs/$id/results/$1"
    into=$work/body
    case $status in
    200) ;;
    [345][0-9][0-9])
        mv "$part" "$work/body"
        complain "$work/body" '' ''
        ;;
    *)
        rm -f "$part"
        silent
        ;;
    esac
    sum=$(sha256sum <"$part")
    if [ "${sum%% *}" != "$3" ]; then
        rm -f "$part"
        error "$1 arrived damaged: its SHA-256 is not the one announced"
        exit 5
    fi
    mv "$part" "$out/$1" || exit 5
    note "  $1  $2 bytes"
}

fetch() {
    id=$1
    [ -n "$out" ] || mistake "fetch needs --out DIR"
    request GET "/v1/jobs/$id/results" || silent
    [ "$status" = 200 ] || complain "$work/body" '' ''
    manifest "$work/body" >"$work/manifest"
    mkdir -p "$out" || exit 5
    note "$out/"
    while read -r file bytes sum; do
        fetch_one "$file" "$bytes" "$sum"
    done <"$work/manifest"
}

remove() {
    request DELETE "/v1/jobs/$1" || silent
    [ "$status" = 204 ] || complain "$work/body" '' ''
    printf '%s removed\n' "$1"
}

# set_pin METHOD ID
set_pin() {
    request "$1" "/v1/jobs/$2/pin" || silent
    [ "$status" = 200 ] || complain "$work/body" '' ''
    if [ "$(value "$work/body" pinned 1)" = true ]; then printf '%s pinned\n' "$2"; else printf '%s unpinned\n' "$2"; fi
}

# ask cancel|finish|retry ID
ask() {
    request POST "/v1/jobs/$2/$1" -d '' || silent
    [ "$status" = 200 ] || complain "$work/body" '' ''
    state=$(value "$work/body" state 1)
    case $1 in
    cancel) [ "$(value "$work/body" cancelling 1)" != true ] || state=cancelling ;;
    finish) [ "$(value "$work/body" finishing 1)" != true ] || state=finishing ;;
    esac
    printf '%s %s\n' "$2" "$state"
}

list() {
    cursor=
    while :; do
        request GET "/v1/jobs?limit=200$cursor" || silent
        [ "$status" = 200 ] || complain "$work/body" '' ''
        # Members of the objects in "jobs" stand at depth 3; deeper ones (options, attempts, failure) do not matter.
        members "$work/body" | awk '
            function text(line) { sub(/^"[a-z]*":/, "", line); return substr(line, 2, length(line) - 2) }
            /^[{\[]$/ { depth++; next }
            /^[}\]]$/ { if (depth == 3 && id != "") { print id "  " state "  " name; id = state = name = "" } depth--; next }
            depth == 3 && /^"id":/ { id = text($0) }
            depth == 3 && /^"state":/ { state = text($0) }
            depth == 3 && /^"name":/ { name = text($0) }' | plain
        next=$(value "$work/body" next 1)
        case $next in
        '') return ;;
        *[!0-9A-Za-z._~-]*)
            error "the daemon gave a cursor this program does not accept"
            exit 5
            ;;
        esac
        cursor="&cursor=$next"
    done
}

# show PATH: prints what the daemon answers there.
show() {
    request GET "$1" || silent
    [ "$status" = 200 ] || complain "$work/body" '' ''
    tr -d '\000-\010\013-\037\177' <"$work/body"
}

# ---- command line ----

server=${BLOCKWRIGHT_SERVER:-http://127.0.0.1:8080}
token=${BLOCKWRIGHT_TOKEN:-}
quiet=no
wait=no
pin=no
follow=no
limits= # as they stand in the request
repair=no
tmesh=no
route=
subdivide=
map_work='' max_hexes=''
smooth=
formats='' bits=''
rounding=no
out=
complex=
reduce=
kind=
explore='' explore_cost='' explore_expand=''
explore_numbers= # as they stand in the request
quantize=
size=
until=
name=
parameters=
command=
operand=
while [ $# -gt 0 ]; do
    case $1 in
    -h | --help)
        usage
        exit 0
        ;;
    --quiet | -q) quiet=yes ;;
    --wait | -w) wait=yes ;;
    --pin) pin=yes ;;
    --follow | -f) follow=yes ;;
    --repair) repair=yes ;;
    --rounding) rounding=yes ;;
    --tmesh) tmesh=yes ;;
    --coarsest) size='"scale": 0' ;;
    --fewest-hexes) size='"fewest_hexes": true' ;;
    --server | --token-file | --out | -o | --kind | --complex | --reduce | --explore | --explore-cost | --explore-weights | --explore-expand | --beam | --seed | --explore-work | --explore-time | --quantize | --scale | --target-hexes | --route | --max-map-work | --subdivide | --max-hexes | --smooth | --hex-formats | --bwh-bits | --until | --name | --parameters | --limit-memory | --limit-scratch | --limit-cpu | --limit-wall | --limit-job-cpu | --limit-job-wall)
        [ $# -ge 2 ] || mistake "$1 needs a value"
        case $1 in
        --server) server=$2 ;;
        --token-file)
            [ -r "$2" ] || mistake "cannot read $2"
            IFS= read -r token <"$2" || [ -n "$token" ] || mistake "$2 is empty"
            ;;
        --out | -o) out=$2 ;;
        --complex) complex=$2 ;;
        --kind) kind=$2 ;;
        --reduce) reduce=$2 ;;
        --explore) explore=$2 ;;
        --explore-cost) explore_cost=$2 ;;
        --explore-expand) explore_expand=$2 ;;
        --explore-weights)
            for weight in $(printf '%s' "$2" | tr ',' ' '); do number "$1" "$weight"; done
            explore_numbers="${explore_numbers:+$explore_numbers, }\"explore_weights\": [$2]"
            ;;
        --beam | --seed | --explore-work | --explore-time)
            number "$1" "$2" && explore_numbers="${explore_numbers:+$explore_numbers, }\"$(printf '%s' "${1#--}" | tr '-' '_')\": $2"
            ;;
        --quantize) quantize=$2 ;;
        --scale) number "$1" "$2" && size="\"scale\": $2" ;;
        --target-hexes) number "$1" "$2" && size="\"target_hexes\": $2" ;;
        --route) route=$2 ;;
        --max-map-work) number "$1" "$2" && map_work=$2 ;;
        --max-hexes) number "$1" "$2" && max_hexes=$2 ;;
        --subdivide) number "$1" "$2" && subdivide=$2 ;;
        --smooth) smooth=$2 ;;
        --hex-formats) formats=$2 ;;
        --bwh-bits) number "$1" "$2" && bits=$2 ;;
        --until) until=$2 ;;
        --name) name=$2 ;;
        --limit-memory | --limit-scratch) number "$1" "$2" && limits="${limits:+$limits, }\"${1#--limit-}\": $2" ;;
        --limit-cpu | --limit-wall) number "$1" "$2" && limits="${limits:+$limits, }\"${1#--limit-}_seconds\": $2" ;;
        --limit-job-cpu | --limit-job-wall) number "$1" "$2" && limits="${limits:+$limits, }\"job_${1#--limit-job-}_seconds\": $2" ;;
        --parameters) parameters=$2 ;;
        esac
        shift
        ;;
    -?*) mistake "unknown option '$1'" ;;
    *)
        if [ -z "$command" ]; then command=$1
        elif [ -z "$operand" ]; then operand=$1
        else mistake "'$1' is one word too many"
        fi
        ;;
    esac
    shift
done
server=${server%/}

for need in curl sha256sum awk sed; do
    command -v $need >/dev/null 2>&1 || {
        error "$need is needed and is not installed"
        exit 5
    }
done
work=$(mktemp -d "${TMPDIR:-/tmp}/blockwright.XXXXXX") || exit 5
streaming=
cr=$(printf '\r')
newline='
'
trap '[ -z "$streaming" ] || kill "$streaming" 2>/dev/null; rm -rf "$work"' EXIT
trap 'exit 130' INT
trap 'exit 143' TERM
into=$work/body
: >"$work/body"
# In a file that nobody else can read, not in curl's words, which everybody can.
(
    umask 077
    [ -z "$token" ] || printf 'header = "Authorization: Bearer %s"\n' "$(printf '%s' "$token" | tr -d '\000-\040"\\\177')"
    [ -z "${BLOCKWRIGHT_CA_FILE:-}" ] || printf 'cacert = "%s"\n' "$(printf '%s' "$BLOCKWRIGHT_CA_FILE" | sed 's/[\\"]/\\&/g')"
) >"$work/curlrc"
case $token:$server in
:* | *:https://* | *:http://127.* | *:http://localhost* | *:http://\[::1\]*) ;;
*) error "warning: the access token goes to $server unencrypted" ;;
esac

case $command in
'') mistake "which command?" ;;
ls | capabilities) [ -z "$operand" ] || mistake "$command takes no operand" ;;
submit) [ -n "$operand" ] || mistake "submit needs a FILE" ;;
watch | fetch | finish | cancel | retry | rm | pin | unpin | log | report) check_id "$operand" ;;
*) mistake "there is no command '$command'" ;;
esac
[ $follow = no ] || [ "$command" = log ] || mistake "--follow goes with log"
case $command in
submit) submit "$operand" ;;
watch)
    watch "$operand"
    printf '%s successful\n' "$operand"
    ;;
fetch) fetch "$operand" ;;
finish | cancel | retry) ask "$command" "$operand" ;;
rm) remove "$operand" ;;
pin) set_pin PUT "$operand" ;;
unpin) set_pin DELETE "$operand" ;;
ls) list ;;
log) if [ $follow = yes ]; then follow_log "$operand"; else show "/v1/jobs/$operand/log"; fi ;;
capabilities) show /v1/capabilities ;;
report) show "/v1/jobs/$operand/report" ;;
esac
