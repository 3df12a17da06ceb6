-- KEYS: the log. ARGV: the number after which, bytes, entries at most. Returns the entries that fit, at least one, up to
-- the first that was lost, which is empty if it is the first of all.
local out, bytes, last, most, limit = {}, 0, tonumber(ARGV[1]), tonumber(ARGV[2]), tonumber(ARGV[3])
local count = 1
while #out < limit do
  local page = redis.call('XRANGE', KEYS[1], string.format('%.0f', last + 1), '+', 'COUNT', math.min(count, limit - #out))
  for _, entry in ipairs(page) do
    if entry[1] ~= string.format('%.0f-0', last + 1) then return #out > 0 and out or {''} end
    bytes = bytes + #entry[2][2]
    if #out > 0 and bytes > most then return out end
    out[#out + 1] = entry[2][2]
    last = last + 1
  end
  if #page < count then return out end
  -- As many as should fit, so that little is read in vain.
  count = math.max(1, math.min(256, math.floor((most - bytes) * #out / (bytes + #out))))
end
return out
