# Completion of Quarry's commands in bash. Options and commands are those that --help names, so they are the installed programs' own.

# What --help of the words names: options with "--", commands without.
_quarry_options() {
  "$@" --help 2>/dev/null | grep -oE '^  (-[a-zA-Z],)?--[a-zA-Z-]+(,--[a-zA-Z-]+)?' | grep -oE -- '--[a-zA-Z-]+'
}

_quarry_commands() {
  "$@" --help 2>/dev/null | sed -n '/^Subcommands:/,/^$/s/^  \([a-z]*\) .*/\1/p'
}

_quarry_benches() {
  quarry bench --help 2>/dev/null | sed -n 's/^WHAT is one of: //p' | tr -d ,
}

_quarry_modes() {
  quarry render --help 2>/dev/null | sed -n 's/^  --mode TEXT=[a-z]* *//p' | sed 's/,/ /g; s/ or / /'
}

_quarry() {
  local cur prev words cword
  _init_completion -n = || return
  local command=("${words[0]}")
  # Commands are words without a dash, before the first option.
  local i=1 commands
  while [ "$i" -lt "$cword" ]; do
    commands=$(_quarry_commands "${command[@]}")
    [ -n "$commands" ] && [[ " ${commands//$'\n'/ } " == *" ${words[i]} "* ]] || break
    command+=("${words[i]}")
    i=$((i + 1))
  done

  case "$prev" in
    --mode) COMPREPLY=($(compgen -W "$(_quarry_modes)" -- "$cur")); return ;;
    --view) COMPREPLY=($(compgen -W "iso top front back left right inside" -- "$cur")); _filedir json; return ;;
    --up-axis) COMPREPLY=($(compgen -W "y z" -- "$cur")); return ;;
    --schedule) COMPREPLY=($(compgen -W "footprint last-owner random" -- "$cur")); return ;;
    --aov)  # names with commas between them
      local before=""
      [[ "$cur" == *,* ]] && before="${cur%,*},"
      COMPREPLY=($(compgen -P "$before" -W "depth normal uv primitive material part voxel albedo" -- "${cur##*,}"))
      return ;;
    --peers) COMPREPLY=($(compgen -W "auto off" -- "$cur")); return ;;
    --master) _known_hosts_real -- "$cur"; return ;;
    --tmp | --spool) _filedir -d; return ;;
    --lights | --camera-path) _filedir json; return ;;
    -o | --output | --stats | --write-view | --trace | --*-file | --tls-* | --http-aws | --preparing) _filedir; return ;;
    --workers | --threads | --cache | --size | --crop | --fov | --spp | --seed | --memory | --listen | --http | --metrics | --name) return ;;
  esac
  if [[ "$cur" == -* ]]; then
    COMPREPLY=($(compgen -W "$(_quarry_options "${command[@]}")" -- "$cur"))
    return
  fi
  if [ "${command[*]}" = "quarry bench" ]; then
    COMPREPLY=($(compgen -W "$(_quarry_benches)" -- "$cur"))
    return
  fi
  commands=$(_quarry_commands "${command[@]}")
  if [ "$i" -eq "$cword" ] && [ -n "$commands" ]; then
    COMPREPLY=($(compgen -W "$commands" -- "$cur"))
    return
  fi
  _filedir
} && complete -F _quarry quarry quarry-master quarry-worker quarry-preprocess quarry-scene
